"""The configuration that a daemon runs with, kept in its state folder for those who read the state."""

from __future__ import annotations

import os
from pathlib import Path

from service.config.site import Config
from service.config.written import effective_toml
from service.errors import ServiceError
from service.store.durable_files import sync_folder
from service.store.store import CONFIGURATION

FILE = CONFIGURATION


def keep_configuration(config: Config) -> None:
    """Write the effective `config` into its state folder, readable for its owner only; OSError where that fails."""
    folder = config.site.state_dir
    temporary = folder / f"{FILE}.tmp"
    temporary.unlink(missing_ok=True)
    with open(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write("# Written by the daemon at every start and reload; changes here have no effect.\n")
        file.write(effective_toml(config))
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(folder / FILE)
    sync_folder(folder)


def kept_configuration(state_dir: Path) -> Path:
    """The configuration of the daemon whose state is in `state_dir`; ServiceError where none was kept."""
    path = state_dir / FILE
    if not path.exists():
        raise ServiceError(
            f"there is no {FILE} in {state_dir}, which the daemon writes at its start; name the configuration with "
            "--config, or the folder that site.state_dir names"
        )
    return path
