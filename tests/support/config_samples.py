"""A sound two-zone configuration for the tests of configuration and command line to start from."""

import shutil
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from support.zone_samples import sample

from service.config.fitting import fingerprint
from service.config.site import Config
from service.store.journal import Journal
from service.store.store import JOURNAL

SUN = {"source": "log", "column": "Sun", "unit": "W/m2"}
CASES = Path(__file__).parents[1] / "service" / "config" / "cases"
HEADER = (CASES / "log.csv").read_text(encoding="utf-8").splitlines()[0]


def sound(folder: Path) -> dict[str, Any]:
    """Tables of a configuration that passes, with its recording in `folder`."""
    shutil.copy(CASES / "log.csv", folder)
    return tomllib.loads((CASES / "house.toml").read_text(encoding="utf-8"))


def write(folder: Path, tables: dict[str, Any]) -> Path:
    """`tables` as a configuration file in `folder`."""
    path = folder / "house.toml"
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path


def changed(
    folder: Path, site: dict[str, Any] | None = None, channels: dict[str, Any] | None = None, **living: Any
) -> Path:
    """The sound configuration with more in [site], more channels of its living room, and `living` in that table."""
    tables = sound(folder)
    tables["site"] |= site or {}
    tables["zones"][0] |= living
    tables["zones"][0]["channels"] |= channels or {}
    return write(folder, tables)


def learned(config: Config, zone: int = 0) -> None:
    """Leave state of the zone at the place `zone`, as a daemon does."""
    table = config.zones[zone]
    journal = Journal.open(config.site.state_dir / JOURNAL)
    assert journal.claim(table.id, fingerprint(table))
    journal.append_all([(table.id, sample(1))])
    journal.close()
