"""The configuration that a daemon runs with, kept in its state folder for those who read the state."""

from pathlib import Path

from service.config.site import Config
from service.config.written import effective_toml
from service.errors import ServiceError
from service.store.durable_files import replace_file, sync_folder
from service.store.store import CONFIGURATION


def keep_configuration(config: Config) -> None:
    """Write the effective `config` into its state folder, readable for its owner only; OSError where that fails."""
    head = "# Written by the daemon at every start and reload, and by learn; changes here have no effect.\n"
    replace_file(config.site.state_dir / CONFIGURATION, f"{head}{effective_toml(config)}".encode())
    sync_folder(config.site.state_dir)


def kept_configuration(state_dir: Path) -> Path:
    """The configuration of the daemon whose state is in `state_dir`; ServiceError where none was kept."""
    path = state_dir / CONFIGURATION
    if not path.exists():
        raise ServiceError(
            f"there is no {CONFIGURATION} in {state_dir}, which the daemon and `thermogate learn` write; name the "
            "configuration with --config, or the folder that site.state_dir names"
        )
    return path
