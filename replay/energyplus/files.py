"""A recording as files: what the logger has, a configuration that replays it, and the truth beside it."""

import json
from pathlib import Path
from typing import Any

import tomli_w

from replay.energyplus.buildings import Building
from replay.energyplus.epjson import STEP
from replay.energyplus.heat_loss import HeatLoss
from replay.energyplus.recording import Recording
from replay.recorded.tables import cells, utc_stamps, write_table

RECORDING, TRUTH, HEAT_LOSS, CONFIGURATION = "recording.csv", "truth.csv", "heat-loss.json", "zones.toml"

_OUTDOORS, _SUN, _SOUTH = "outdoor_degC", "irradiance_W_m2", "irradiance_south_W_m2"


def write_recording(directory: Path, recording: Recording, loss: HeatLoss) -> Path:
    """Write the four files into `directory`, made if need be; the path of the configuration."""
    directory.mkdir(parents=True, exist_ok=True)
    building, stamps = recording.building, utc_stamps(recording.times)
    columns = {"time": stamps, _OUTDOORS: cells(recording.outdoor, 2)}
    columns |= {_SUN: cells(recording.irradiance, 1), _SOUTH: cells(recording.facade, 1)}
    truth = {"time": stamps, "wind_m_s": cells(recording.wind, 2)}
    for index, room in enumerate(building.rooms):
        columns[f"{room.name}_degC"] = cells(recording.air[:, index], 2)
        columns[f"{room.name}_set_point_degC"] = cells(recording.set_points[:, index], 1)
        columns[f"{room.name}_heating_W"] = cells(recording.heating[:, index], 1)
        truth[f"{room.name}_degC"] = cells(recording.exact[:, index], 4)
        truth[f"{room.name}_persons"] = cells(recording.persons[:, index], 0)
        truth |= {
            f"{room.name}_{name}_W": cells(values[:, index], 2)
            for name, values in (*recording.truth._asdict().items(), ("gain", recording.truth.gain))
        }
    write_table(directory / RECORDING, columns)
    write_table(directory / TRUTH, truth)
    (directory / HEAT_LOSS).write_text(json.dumps(_as_json(building, loss), indent=2) + "\n", encoding="utf-8")
    path = directory / CONFIGURATION
    path.write_text(_HEAD.format(what=building.what) + tomli_w.dumps(_configuration(building)), encoding="utf-8")
    return path


def _as_json(building: Building, loss: HeatLoss) -> dict[str, Any]:
    names = [room.name for room in building.rooms]
    return {
        "unit": "W/K",
        "rooms": {
            name: {
                "outdoors": round(float(loss.outdoors[index]), 2),
                "neighbours": {names[other]: round(float(loss.between[index, other]), 2) for other in near},
            }
            for index, name in enumerate(names)
            for near in [building.neighbours(index)]
        },
    }


def _configuration(building: Building) -> dict[str, Any]:
    """One zone for every room, with the network that follows from its channels."""
    names = [room.name for room in building.rooms]

    def celsius(column: str) -> dict[str, Any]:
        return {"source": "recording", "column": column, "unit": "degC"}

    zones = []
    for index, room in enumerate(building.rooms):
        beside = [names[other] for other in building.neighbours(index)]
        channels = {"T_i": celsius(f"{room.name}_degC"), "T_out": celsius(_OUTDOORS)}
        channels |= {f"T_adj_{name}": celsius(f"{name}_degC") for name in beside}
        channels |= {
            "u_heat": {"source": "recording", "column": f"{room.name}_heating_W", "unit": "W"},
            "I_sol": {"source": "recording", "column": _SUN, "unit": "W/m2"},
        }
        zones.append(
            {
                "id": room.name,
                "period": round(STEP),
                "network": "auto",
                "estimator": "mkf",
                "channels": channels,
                "setpoint": celsius(f"{room.name}_set_point_degC"),
            }
        )
    return {
        "site": {"id": building.name, "state_dir": "state"},
        "sources": {
            "recording": {
                "kind": "csv",
                "files": [RECORDING],
                "timestamp": {"column": "time", "format": "iso8601"},
            }
        },
        "zones": zones,
    }


_HEAD = """\
# Written by `thermogate simulate-energyplus`: {what}, simulated by EnergyPlus. No building stands behind it.
# Replay it with `thermogate replay`, and compare with truth.csv and heat-loss.json, which no zone reads.

"""
