"""A process becomes a driver of a Ray cluster, and leaves it again."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from service.errors import ServiceError

_OBJECT_STORE = 80 * 2**20
"""Shared memory of a cluster on one machine, bytes: what members send each other is small."""

_ADDRESS = "address"
"""The file with the address of the cluster that a run has started on this machine alone."""

QUIET = {
    # Ray would tell its makers that it is used, and paint the lines of others.
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_COLOR_PREFIX": "0",
    "RAY_DEDUP_LOGS": "0",
    # A machine that is lost is noticed after this many missed signs of life, s and their number.
    "RAY_health_check_initial_delay_ms": "2000",
    "RAY_health_check_period_ms": "1000",
    "RAY_health_check_timeout_ms": "2000",
    "RAY_health_check_failure_threshold": "3",
    # Nothing idle but what the gateways keep for shards that have to start, and that for as long as it is idle.
    "RAY_prestart_worker_first_driver": "0",
    "RAY_num_workers_soft_limit": "4096",
    # What members do is what the machines are for; Ray would let everything else on them go first.
    "RAY_worker_niceness": "0",
}


def join(address: str | None, alone: bool = False) -> None:
    """Join the cluster at `address`, or start one of this machine `alone`; None: the one that was started so, or any
    that is on this machine. Raises ServiceError."""
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    folder = Path(tempfile.gettempdir()) / f"thermogate-ray-{os.getuid()}"
    known = folder / _ADDRESS
    if address is None and not alone and known.exists():
        address = known.read_text(encoding="utf-8")
    if alone or (address or "").startswith("127.0.0.1:"):
        # Ray otherwise takes any other address of this machine, and listens on all of them.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    import ray

    options: dict[str, Any] = {"log_to_driver": alone, "configure_logging": False, "logging_level": logging.ERROR}
    if alone:
        folder.mkdir(mode=0o700, exist_ok=True)
        options |= {"include_dashboard": False, "object_store_memory": _OBJECT_STORE, "_temp_dir": str(folder)}
    else:
        options["address"] = address or "auto"
    try:
        ray.init(**options)
    except (ConnectionError, ValueError, RuntimeError) as error:
        first = str(error).splitlines()[0]
        raise ServiceError(
            f"the Ray cluster {address or 'of this machine'} cannot be joined ({first}); start one with `ray start "
            "--head`, or name another with --address"
        ) from error
    if alone:
        known.write_text(ray.get_runtime_context().gcs_address, encoding="utf-8")


def leave() -> None:
    """Leave the cluster; one that was started for this process alone ends."""
    import ray

    ray.shutdown()
    sys.stdout.flush()
