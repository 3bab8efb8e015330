"""Databases of the schema of Home Assistant's recorder."""

import sqlite3
from contextlib import closing
from pathlib import Path

BEGIN = 1_760_000_000 // 3600 * 3600
"""UTC s of a whole hour."""

SCHEMA = Path(__file__).with_name("recorder.sql").read_text(encoding="utf-8")


def database(path, rows, runs=((0, None),), attributes='{"unit_of_measurement": "°C"}', statistics=(), began=BEGIN):
    """`rows`: seconds since `began`, entity, state or (state, attributes); `statistics`: hours, entity, mean, state."""
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(SCHEMA)
        entities = list(dict.fromkeys([row[1] for row in rows] + [row[1] for row in statistics]))
        connection.executemany("INSERT INTO states_meta VALUES (?, ?)", enumerate(entities))
        connection.executemany("INSERT INTO statistics_meta VALUES (?, ?, 'recorder', '°C')", list(enumerate(entities)))
        for number, (seconds, entity, told) in enumerate(rows):
            state, own = told if isinstance(told, tuple) else (told, attributes)
            connection.execute("INSERT INTO state_attributes VALUES (?, ?)", (number, own))
            values = (number, entities.index(entity), number, state, began + seconds)
            connection.execute("INSERT INTO states VALUES (?, NULL, ?, ?, ?, ?)", values)
        for begin, end in runs:
            stamps = [
                None
                if moment is None
                else connection.execute("SELECT datetime(?, 'unixepoch')", (began + moment,)).fetchone()[0]
                for moment in (begin, end)
            ]
            connection.execute('INSERT INTO recorder_runs (start, "end") VALUES (?, ?)', stamps)
        for hours, entity, mean, state in statistics:
            values = (entities.index(entity), began + 3600 * hours, mean, state)
            connection.execute(
                "INSERT INTO statistics (metadata_id, start_ts, mean, state) VALUES (?, ?, ?, ?)", values
            )
        connection.commit()
    return path
