"""Where a store keeps what it has, for tests that hold the same of every store."""

import sqlite3
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager, closing
from pathlib import Path

from support.shards import Shards

from service.store.journalling import JournalStore
from service.store.postgres.reading import read_site
from service.store.reading import StoredState, read_state
from service.store.store import CHECKPOINTS, JOURNAL, Store


class Kept:
    """A folder or a database in which a store is opened again and again by `open`.

    `read` shows what it holds, beside its owner; `damage_checkpoint` changes a bit of the checkpoint of zone "z" at a
    step; `change` runs a statement of SQL beside the store, with {} before the name of a table.
    """

    open: Callable[[], JournalStore]

    @asynccontextmanager
    async def opened(self, zones: str = "z") -> AsyncIterator[JournalStore]:
        """The store, open, with zones that are claimed with the fingerprint "f"."""
        store = self.open()
        try:
            for zone in zones:
                await store.claim(zone, "f")
            yield store
        finally:
            store.close()


class InFolder(Kept):
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def open(self) -> JournalStore:
        return Store(self._folder)

    def read(self) -> AbstractContextManager[StoredState]:
        return read_state(self._folder)

    def damage_checkpoint(self, step: int) -> None:
        path = self._folder / CHECKPOINTS / "z" / f"{step:012d}.npz"
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)

    def change(self, statement: str) -> None:
        with closing(sqlite3.connect(self._folder / JOURNAL)) as connection, connection:
            assert connection.execute(statement.format("")).rowcount == 1


class InDatabase(Kept):
    def __init__(self, shards: Shards) -> None:
        self._shards = shards

    def open(self) -> JournalStore:
        # The same owner each time, as a daemon that is started again: an earlier epoch is over then.
        return self._shards.store()

    def read(self) -> AbstractContextManager[StoredState]:
        return read_site(self._shards.connection, self._shards.site)

    def damage_checkpoint(self, step: int) -> None:
        changed = "set_byte(content, length(content) / 2, get_byte(content, length(content) / 2) # 1)"
        self._shards.sql(f"UPDATE {{}}.checkpoints SET content = {changed} WHERE step = {step}")

    def change(self, statement: str) -> None:
        self._shards.sql(statement.format("{}."))
