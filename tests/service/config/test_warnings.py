"""What `thermogate check` and the log warn of, and start nevertheless."""

from pathlib import Path
from typing import Any

from support.config_samples import sound, write
from support.tables import tabled

from service.config.load import load


def on_modbus(folder: Path, heat: dict[str, Any], **source: object) -> dict[str, Any]:
    """The sound configuration with its first zone on Modbus."""
    tables = sound(folder)
    tables["sources"]["bms"] = {"kind": "modbus", "host": "10.0.0.5", "first_register": 0, "type": "float32"} | source
    tables["zones"][0]["channels"] = {
        "T_i": {"source": "bms", "register": 0, "unit": "degC"},
        "T_out": {"source": "bms", "register": 2, "unit": "degC"},
        "u_heat": {"source": "bms", "register": 4, "unit": "kW"} | heat,
    }
    return tables


@tabled
def test_no_word_where_it_is_meant(heat: dict[str, Any], source: dict[str, Any], tmp_path: Path) -> None:
    assert load(write(tmp_path, on_modbus(tmp_path, heat, **source))).warnings == ()
