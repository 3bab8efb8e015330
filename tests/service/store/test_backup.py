"""A backup is whole or not at all, and what is restored goes on with the same bits."""

import asyncio
import hashlib
import io
import json
import os
import shutil
import sqlite3
import stat
import struct
import tarfile
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from support.certificates import make_pair
from support.running_zone import Announced, fed, finished, make, plumbing, straight
from support.tables import tabled
from support.zone_samples import comparable, sample

from service.cli.main import main
from service.errors import BackupError, JournalError, ServiceError
from service.store import backup as module
from service.store.backup import FORMAT_VERSION, restore_backup, write_backup
from service.store.checkpoint import CheckpointStore
from service.store.journal import Journal
from service.store.ownership import database
from service.store.retention import Limits, prune
from service.store.store import CHECKPOINTS, CONFIGURATION, JOURNAL, RESTORING, Store
from service.store.verifying import verify

ITEMS = [sample(k) for k in range(60)]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A state folder of 40 samples, 20 of them before the first of two checkpoints, and a backup from between these."""
    folder = tmp_path_factory.mktemp("made")
    state = folder / "state"

    async def scenario() -> None:
        for first in (0, 20):
            async with plumbing(state) as shared:
                zone = make(shared)
                running = await fed(zone, ITEMS[first : first + 20])
                if first:
                    await zone.settled()
                    await asyncio.to_thread(write_backup, state, "house", folder / "kept.tar")
                await finished(zone, running)

    asyncio.run(scenario())
    return folder


@pytest.fixture
def kept(made: Path, tmp_path: Path) -> Path:
    """The backup, beside its state folder."""
    shutil.copytree(made / "state", tmp_path / "state")
    return Path(shutil.copy(made / "kept.tar", tmp_path))


def hold_that_it_goes_on(state: Path) -> None:
    """A zone on `state`, with the rest of ITEMS, is as if it had never stopped."""

    async def scenario() -> None:
        announcer = Announced()
        async with plumbing(state, announcer) as shared:
            zone = make(shared)
            assert await zone.prepare() == ITEMS[39].time
            running = asyncio.create_task(zone.run())
            await zone.intake.accept(ITEMS[40:])
            await finished(zone, running)
            assert [row.time for row in await zone.history(None, None, 100)] == [item.time for item in ITEMS]
        assert [comparable(update) for _, update in announcer.updates] == straight(ITEMS)[39:]

    asyncio.run(scenario())


def refused(sentence: str, call: Callable[..., object], *given: object, **named: object) -> None:
    """`call` with what is given to it is refused with `sentence`."""
    with pytest.raises(BackupError, match=sentence):
        call(*given, **named)


def test_what_is_restored_goes_on_bit_for_bit(kept: Path, tmp_path: Path) -> None:
    refused("a backup of the site 'house'", restore_backup, tmp_path / "new", "school", kept, replace=False)
    restored, aside = restore_backup(tmp_path / "new", "house", kept, replace=False)
    assert (restored.zones, aside) == (1, None)
    hold_that_it_goes_on(tmp_path / "new")


def test_a_backup_is_made_of_what_nobody_runs_too(kept: Path, tmp_path: Path) -> None:
    checkpoints = tmp_path / "state" / CHECKPOINTS
    for copy in ("z.old", "z copy", "Z"):
        # No zone has such a name.
        shutil.copytree(checkpoints / "z", checkpoints / copy)
    (tmp_path / "backups").mkdir()
    found = write_backup(tmp_path / "state", "house", tmp_path / "backups")
    assert (found.path.parent, found.zones) == (tmp_path / "backups", 1)
    assert found.path.name.startswith("thermogate-house-")
    assert os.listdir(tmp_path / "backups") == [found.path.name], "nothing else is left there"


def test_nothing_is_overwritten(kept: Path, tmp_path: Path) -> None:
    state = tmp_path / "state"
    before = {path: path.read_bytes() for path in (kept, *state.rglob("*.npz"))}
    refused("exists already", write_backup, state, "house", kept)
    refused("--replace", restore_backup, state, "house", kept, replace=False)
    assert {path: path.read_bytes() for path in before} == before
    _, aside = restore_backup(state, "house", kept, replace=True)
    assert (aside / JOURNAL).exists()
    assert len(list((aside / CHECKPOINTS / "z").glob("*.npz"))) == 2
    hold_that_it_goes_on(state)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may restore for another user")
def test_root_restores_for_the_user_of_the_daemon(kept: Path, tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    os.chown(tmp_path / "new", 12345, 12345)
    restore_backup(tmp_path / "new", "house", kept, replace=False)
    assert {path.stat().st_uid for path in (tmp_path / "new").rglob("*")} == {12345}
    assert {stat.S_IMODE(path.stat().st_mode) & 0o077 for path in (tmp_path / "new").rglob("*")} == {0}


@pytest.fixture
def secret(tmp_path: Path) -> Iterator[Path]:
    """A file that only root may read, and that nothing may have touched by the end."""
    file = tmp_path / "secret"
    file.write_bytes(b"# root's alone\n")
    file.chmod(0o600)
    before = file.stat()
    yield file
    after = file.stat()
    assert (after.st_uid, after.st_mode, after.st_mtime_ns) == (before.st_uid, before.st_mode, before.st_mtime_ns)


def of_another(folder: Path) -> Path:
    """`folder` with all that is in it, given to an account that is not root's."""
    for path in (folder, *folder.rglob("*")):
        os.chown(path, 12345, 12345, follow_symlinks=False)
    return folder


as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be led to what others may not reach")


@as_root
@pytest.mark.parametrize("name", ["lock", "restoring.tmp", "restoring"])
def test_a_link_does_not_lead_root_out_of_the_folder_that_it_restores(
    name: str, kept: Path, tmp_path: Path, secret: Path
) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    state = tmp_path / "new"
    state.mkdir()
    (state / name).symlink_to(secret if name == "lock" else inside)
    of_another(state)
    with suppress(ServiceError):
        restore_backup(state, "house", kept, replace=False)
    assert not list(inside.iterdir())


@as_root
def test_root_backs_up_nothing_that_the_account_may_not_read(kept: Path, tmp_path: Path, secret: Path) -> None:
    state = tmp_path / "state"
    (state / CONFIGURATION).unlink(missing_ok=True)
    (state / CONFIGURATION).symlink_to(secret)
    of_another(state)
    with pytest.raises(BackupError, match=r"configuration\.toml is a link or another kind of file"):
        write_backup(state, "house", tmp_path / "out.tar")
    (state / CONFIGURATION).unlink()
    for path in (state / CHECKPOINTS / "z").iterdir():
        path.rename(tmp_path / path.name)
        os.chown(tmp_path / path.name, 0, 0)
        os.chmod(tmp_path / path.name, 0o600)
        path.symlink_to(tmp_path / path.name)
    assert write_backup(state, "house", tmp_path / "out.tar").zones == 0
    (state / JOURNAL).rename(tmp_path / JOURNAL)
    (state / JOURNAL).symlink_to(tmp_path / JOURNAL)
    refused(r"journal\.sqlite3 is a link or another kind of file", write_backup, state, "house", tmp_path / "again.tar")


@as_root
def test_root_ends_no_transaction_that_the_account_has_made_up(kept: Path, tmp_path: Path, secret: Path) -> None:
    """At the end of a rollback SQLite deletes the file that its journal names as that of the whole transaction."""
    state = tmp_path / "state"
    with closing(sqlite3.connect(state / JOURNAL)) as journal:
        (page,) = journal.execute("PRAGMA page_size").fetchone()
        (pages,) = journal.execute("PRAGMA page_count").fetchone()
    magic, name = bytes.fromhex("d9d505f920a163d7"), bytes(secret)
    head = magic + struct.pack(">5I", 0, 0, pages, 512, page)
    named = struct.pack(">I", 2**30 // page + 1) + name + struct.pack(">2I", len(name), sum(name)) + magic
    (state / f"{JOURNAL}-journal").write_bytes(head.ljust(512, b"\0") + named)
    of_another(state)
    for out in ("one.tar", "two.tar"):
        with suppress(BackupError):
            write_backup(state, "house", tmp_path / out)
    assert secret.exists()


@tabled
def test_a_journal_without_end_is_not_read(statement: str, kept: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "state" / JOURNAL)) as journal:
        journal.executescript(statement)
    refused("is damaged, or made to do damage", write_backup, tmp_path / "state", "house", tmp_path / "out.tar")
    assert "does not belong into it" in "".join(verify(tmp_path / "state").problems)


def test_what_sqlite_opens_is_compared_with_what_was_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The account puts a link in the place of its file just before SQLite opens it."""
    mine, other = tmp_path / "mine", tmp_path / "other"
    for path in (mine, other):
        with closing(sqlite3.connect(path)) as made:
            made.execute("CREATE TABLE a (b)")
    connect = sqlite3.connect

    def swapped(*arguments: Any, **options: Any) -> sqlite3.Connection:
        mine.unlink()
        mine.symlink_to(other)
        return connect(*arguments, **options)

    with database(mine) as sound:
        assert sound.execute("SELECT count(*) FROM a").fetchone() == (0,)
    monkeypatch.setattr(sqlite3, "connect", swapped)
    with pytest.raises(OSError, match="is a link or another kind of file"), database(mine):
        pass


@tabled
def test_a_journal_that_would_do_something_of_its_own_is_not_restored(
    statement: str, told: str, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A trigger that ignores every row would have the daemon acknowledge what is never written."""
    state = tmp_path / "state"
    with closing(sqlite3.connect(state / JOURNAL)) as journal:
        journal.execute(statement)
    with pytest.raises(JournalError, match=told):
        Store(state)
    refused(told, write_backup, state, "house", tmp_path / "evil.tar")
    with monkeypatch.context() as blind:
        blind.setattr(module, "schema_problem", lambda journal: None)
        evil = write_backup(state, "house", tmp_path / "evil.tar")
    refused(told, restore_backup, tmp_path / "new", "house", evil.path, replace=False)
    assert os.listdir(tmp_path / "new") == ["lock"]


@tabled
def test_what_cannot_be_backed_up_leaves_nothing(state: str, out: str, told: str, kept: Path, tmp_path: Path) -> None:
    (tmp_path / "interrupted" / RESTORING).mkdir(parents=True)
    before = sorted(tmp_path.iterdir())
    refused(told, write_backup, tmp_path / state, "house", tmp_path / out)
    assert sorted(tmp_path.iterdir()) == before


def key_files(folder: Path) -> tuple[Path, Path]:
    """A private and a public key."""
    key = Ed25519PrivateKey.generate()
    private, public = folder / "backup.key", folder / "backup.pub"
    private.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    public.write_bytes(key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    return private, public


def test_a_signed_backup_cannot_be_made_up(kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    private, public = key_files(tmp_path)
    signed = write_backup(tmp_path / "state", "house", tmp_path / "signed.tar", private)
    assert signed.signed
    assert main(["verify", str(signed.path), "--signed-by", str(public)]) == 0
    restored, _ = restore_backup(tmp_path / "new", "house", signed.path, False, public)
    assert restored.signed
    # Whoever changes a file can write a manifest that fits, but no signature.
    with tarfile.open(signed.path) as archive:
        archive.extractall(tmp_path / "forged", filter="data")
    (tmp_path / "forged" / CONFIGURATION).write_bytes(b"")
    manifest = json.loads((tmp_path / "forged" / "manifest.json").read_text())
    manifest["files"][CONFIGURATION] = {"size": 0, "sha256": hashlib.sha256(b"").hexdigest()}
    (tmp_path / "forged" / "manifest.json").write_text(json.dumps(manifest))
    with tarfile.open(tmp_path / "forged.tar", "w") as archive:
        for name in ("manifest.json", *manifest["files"]):
            archive.add(tmp_path / "forged" / name, name)
    assert main(["verify", str(tmp_path / "forged.tar")]) == 0
    for wrong, of in ((tmp_path / "forged.tar", public), (kept, public), (signed.path, key_files(tmp_path)[1])):
        refused("is not signed with that key", restore_backup, tmp_path / "other", "house", wrong, False, of)
        assert main(["verify", str(wrong), "--signed-by", str(of)]) != 0
    assert not (tmp_path / "other" / JOURNAL).exists()
    assert "is not signed with that key" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"-----BEGIN PRIVATE KEY-----", b"rsa"])
def test_a_file_that_is_no_key_signs_nothing(content: bytes | None, kept: Path, tmp_path: Path) -> None:
    private = tmp_path / "backup.key"
    if content == b"rsa":
        content = make_pair(tmp_path, kind="rsa").private_key.read_bytes()
    if content is not None:
        private.write_bytes(content)
    with pytest.raises(BackupError, match=r"cannot be read|has no private key"):
        write_backup(tmp_path / "state", "house", tmp_path / "signed.tar", private)
    assert not (tmp_path / "signed.tar").exists()
    refused(r"cannot be read|has no public key", restore_backup, tmp_path / "new", "house", kept, False, private)


def test_damage_anywhere_is_refused_and_changes_nothing(kept: Path, tmp_path: Path) -> None:
    content = kept.read_bytes()
    damaged = tmp_path / "damaged.tar"
    offsets, refusals = range(0, len(content), 1997), 0
    for part in (0.0, 0.01, 0.5, 0.8):
        damaged.write_bytes(content[: int(part * len(content))])
        with pytest.raises(BackupError):
            restore_backup(tmp_path / "new", "house", damaged, replace=False)
    for offset in offsets:
        flipped = bytearray(content)
        flipped[offset] ^= 0x10
        damaged.write_bytes(flipped)
        try:
            restore_backup(tmp_path / "new", "house", damaged, replace=True)
        except BackupError as error:
            refusals += "\n" not in str(error)
            assert os.listdir(tmp_path / "new") == ["lock"]
        else:
            # Padding and the owners in tar's headers are nobody's data.
            with closing(Journal.open(tmp_path / "new" / JOURNAL)) as journal:
                assert len(list(journal.samples_after("z", None))) == 40
            shutil.rmtree(tmp_path / "new")
    assert refusals > 0.8 * len(offsets)


def test_checkpoints_and_journal_go_together(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the copies of checkpoint and journal the daemon writes new checkpoints and prunes what they spare."""
    state, pruned = tmp_path / "state", []
    copy_checkpoints = module._copy_checkpoints

    def copied(state_dir: Path, folder: Path) -> dict[str, int]:
        steps = copy_checkpoints(state_dir, folder)
        if not pruned:
            store = CheckpointStore(state / "checkpoints")
            newest = store.load("z", "mark")
            assert newest is not None
            for k in (40, 41, 42):
                store.save("z", newest._replace(step=300 * k))
            with closing(Journal.open(state / JOURNAL)) as journal:
                journal.append_all([("z", item) for item in ITEMS[40:50]])
                pruned.extend(prune(journal, store.oldest, Limits(600.0, 1e12)))
        return steps

    monkeypatch.setattr(module, "_copy_checkpoints", copied)
    with tarfile.open(write_backup(state, "house", tmp_path / "out.tar").path) as archive:
        assert "checkpoints/z/000000012600.npz" in archive.getnames(), "it was copied once more"


def manifest(size: int | str, name: str = JOURNAL, digest: str = "0" * 64) -> bytes:
    files = {JOURNAL: {"size": 4, "sha256": EVIL}} | {name: {"size": size, "sha256": digest}}
    return json.dumps({"format": 1, "site": "house", "made": "2025-01-01T00:00:00+00:00", "files": files}).encode()


EVIL = hashlib.sha256(b"evil").hexdigest()
MADE_UP: dict[str, list[tuple[str, bytes | None]]] = {
    "a link": [("manifest.json", manifest(0)), (JOURNAL, None)],
    "a link for a manifest": [("manifest.json", None)],
    "deep": [("manifest.json", b"[" * 200_000)],
    "claims more": [("manifest.json", manifest(20_000_000_000)), (JOURNAL, b"x" * 10)],
    "negative": [("manifest.json", manifest(-1))],
    "no number": [("manifest.json", manifest("many"))],
} | {
    name: [("manifest.json", manifest(4, name, EVIL)), (name, b"evil")]
    for name in ("../outside", "/etc/passwd", "checkpoints/../../x/1.npz", "checkpoints/z/evil.py")
}


@pytest.mark.parametrize("case", MADE_UP)
def test_a_made_up_archive_is_refused_in_a_sentence(tmp_path: Path, case: str) -> None:
    evil = tmp_path / "evil.tar"
    with tarfile.open(evil, "w") as archive:
        for name, content in MADE_UP[case]:
            info = tarfile.TarInfo(name)
            if content is None:
                info.type, info.linkname = tarfile.SYMTYPE, "nowhere"
            info.size = len(content or b"")
            archive.addfile(info, io.BytesIO(content or b""))
    refused("damaged", restore_backup, tmp_path / "new", "house", evil, replace=False)
    assert os.listdir(tmp_path / "new") == ["lock"]
    assert not (tmp_path / "outside").exists()


def test_the_kept_configuration_comes_along(kept: Path, tmp_path: Path) -> None:
    state, target = tmp_path / "state", tmp_path / "with.tar"
    (state / CONFIGURATION).write_text("# of the backup\n", encoding="utf-8")
    (state / CONFIGURATION).chmod(0o600)
    write_backup(state, "house", target)
    with tarfile.open(target) as archive:
        first, *others = archive.getnames()
        told = json.load(archive.extractfile(first))  # type: ignore[arg-type]
    assert (first, told["format"], told["site"]) == ("manifest.json", FORMAT_VERSION, "house")
    assert sorted(others) == sorted(told["files"]) == ["checkpoints/z/000000011700.npz", CONFIGURATION, JOURNAL]
    restored, aside = restore_backup(tmp_path / "new", "house", target, replace=False)
    assert ((tmp_path / "new" / CONFIGURATION).read_text(), restored.zones, aside) == ("# of the backup\n", 1, None)
    assert stat.S_IMODE((tmp_path / "new" / CONFIGURATION).stat().st_mode) & 0o077 == 0, "it may hold passwords"
    (state / CONFIGURATION).write_text("# of today\n", encoding="utf-8")
    _, aside = restore_backup(state, "house", target, replace=True)
    assert (aside / CONFIGURATION).read_text() == "# of today\n"
    assert (state / CONFIGURATION).read_text() == "# of the backup\n"
    # One from before they had any leaves the folder's own where it is.
    restore_backup(tmp_path / "new", "house", kept, replace=True)
    assert (tmp_path / "new" / CONFIGURATION).read_text() == "# of the backup\n"
