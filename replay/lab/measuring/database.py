"""What a day of many zones costs a PostgreSQL database: rows, bytes, write-ahead log, and how long commits take.

    python -m replay.lab.measuring.database 'host=db.example dbname=thermogate' --zones 1000

The samples of all zones land at once, every `period` of a day, as fast as the database takes them. It writes into the
site `measured` of that database, which must not be there, and drops it afterwards.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from collections.abc import Sequence
from contextlib import closing
from functools import partial

import numpy as np

from service.errors import ServiceError
from service.records.sample import Sample
from service.records.update import CONSTANT, Forecast, Gate, Score, Update, Volatility
from service.store.checkpoint import Checkpoint
from service.store.postgres.database import Database
from service.store.postgres.leases import Leases
from service.store.postgres.names import schema_of
from service.store.postgres.store import PostgresStore

_SITE = "measured"
_START = 1_735_689_600
_DAY = 86_400
_CHECKPOINT = 2_400_000
"""Bytes of arrays in a checkpoint: 9,000 particles of a titeth network."""
_LEASE = 86_400.0


def measure(connection: str, zones: int, period: int, checkpoints: int) -> dict[str, float]:
    """The figures, by their names with units. ServiceError where the database or the site cannot be used."""
    with closing(Database(connection, _SITE)) as database:
        schema = schema_of(_SITE)
        if database.read("SELECT to_regnamespace(%s) IS NOT NULL", schema)[0][0]:
            raise ServiceError(f"the schema {schema} is there already; drop it with CASCADE, or use another database")
        names = [f"room-{number:06d}" for number in range(zones)]
        figures: dict[str, float] = {"zones": zones, "period_seconds": period}
        try:
            with closing(Leases(connection, _SITE)) as leases:
                # The second one takes over what the first one has left.
                for part in (partial(_day, period=period), partial(_takeover, checkpoints=checkpoints)):
                    lease = leases.acquire("measured", "measured", _LEASE)
                    with closing(PostgresStore(connection, _SITE, lease)) as store:
                        figures |= asyncio.run(part(store, database, names))
        finally:
            database.transaction(lambda cursor: cursor.execute(f'DROP SCHEMA "{schema}" CASCADE'))
    return figures


async def _day(store: PostgresStore, database: Database, zones: Sequence[str], period: int) -> dict[str, float]:
    """A day of samples and history."""
    rng = np.random.default_rng(1)
    await store.take(zones)
    for zone in zones:
        await store.claim(zone, "measured")
    steps, log, commits = _DAY // period, _log_position(database), []
    for step in range(steps):
        when = _START + step * period
        samples = [
            Sample.measured(when, 20 + rng.standard_normal(1), np.array([5.0, 18.0, 600.0]) + rng.standard_normal(3))
            for _ in zones
        ]
        began = time.perf_counter()
        await asyncio.gather(*(store.append(zone, sample) for zone, sample in zip(zones, samples, strict=True)))
        commits.append(time.perf_counter() - began)
        for zone in zones:
            store.record(zone, _update(when, rng))
    await store.write(store.journal.flush)
    zone_days = len(zones) * steps * period / _DAY
    return {
        "rows_per_zone_and_day": 2 * len(zones) * steps / zone_days,
        "samples_bytes_per_zone_and_day": _size(database, "samples") / zone_days,
        "history_bytes_per_zone_and_day": _size(database, "history") / zone_days,
        "log_bytes_per_zone_and_day": (_log_position(database) - log) / zone_days,
        "commit_median_seconds": float(np.median(commits)),
        "commit_p99_seconds": float(np.quantile(commits, 0.99)),
        "samples_per_second": len(zones) * steps / sum(commits),
    }


async def _takeover(
    store: PostgresStore, database: Database, zones: Sequence[str], checkpoints: int
) -> dict[str, float]:
    """Zones that another owner has left, and checkpoints of some of them."""
    began = time.perf_counter()
    await store.take(zones)
    for zone in zones:
        await store.claim(zone, "measured")
    claimed = time.perf_counter() - began
    arrays = {"particles": np.random.default_rng(1).standard_normal(_CHECKPOINT // 8)}
    some, log, began = zones[:checkpoints], _log_position(database), time.perf_counter()
    for zone in some:
        await asyncio.to_thread(store.checkpoints.save, zone, Checkpoint("measured", _START, arrays, {}))
    saved = time.perf_counter()
    logged = _log_position(database) - log
    for zone in some:
        await asyncio.to_thread(store.checkpoints.load, zone, "measured")
    return {
        "claim_seconds_per_zone": claimed / len(zones),
        "checkpoint_save_seconds": (saved - began) / len(some),
        "checkpoint_load_seconds": (time.perf_counter() - saved) / len(some),
        "checkpoint_log_bytes": logged / len(some),
    }


def _size(database: Database, table: str) -> float:
    """Bytes of all months of `table` with their indexes."""
    query = (
        "SELECT coalesce(sum(pg_total_relation_size(inhrelid)), 0)::bigint FROM pg_inherits "
        "WHERE inhparent = to_regclass(%s)"
    )
    return float(database.read(query, table)[0][0])


def _update(when: int, rng: np.random.Generator) -> Update:
    """An update that fills every column of the history."""
    y, mean, sd, lower, upper, residual, *alpha = (20 + rng.standard_normal(10)).tolist()
    score = Score((y,), (mean,), (sd,), (lower,), (upper,), (residual,), 0.95)
    volatility = Volatility(("T_i",), *((value,) for value in alpha))
    forecast = Forecast(when, when, when, (), ())
    gate = Gate(0.5, CONSTANT)
    return Update(
        when, 0, "assimilated", (y,), score, volatility, gate, 4500.5, True, False, -1.5, (), forecast, step_seconds=0.0
    )


def _log_position(database: Database) -> float:
    """Bytes that the server has written to its write-ahead log, those of other databases included."""
    return float(database.read("SELECT pg_current_wal_lsn() - '0/0'::pg_lsn")[0][0])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; 0 if that worked."""
    parser = argparse.ArgumentParser(prog="python -m replay.lab.measuring.database", description=__doc__)
    parser.add_argument("connection", help="of the database, such as 'host=db.example dbname=thermogate'")
    parser.add_argument("--zones", type=int, default=1000)
    parser.add_argument("--period", type=int, default=600, help="s between two samples of a zone")
    parser.add_argument("--checkpoints", type=int, default=100, help="checkpoints that are saved and loaded")
    parsed = parser.parse_args(arguments)
    try:
        print(json.dumps(measure(parsed.connection, parsed.zones, parsed.period, parsed.checkpoints), indent=2))
    except ServiceError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
