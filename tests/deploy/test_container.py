"""The container image: its definition read, and the daemon under what it asks for, as far as that needs no engine."""

import json
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import llvmlite
import pytest
import yaml
from support.harness import EXAMPLES, ROOT, THERMOGATE, ask, thermogate
from support.processes import Program

FOLDER = ROOT / "deploy" / "container"
SERVICE = yaml.safe_load((FOLDER / "compose.yaml").read_text(encoding="utf-8"))["services"]["thermogate"]
STAGES = [
    [line.split(maxsplit=1) for line in stage.splitlines() if line and not line.startswith("#")]
    for stage in re.split(
        r"^(?=FROM )",
        re.sub(r"\\\n\s*", "", (FOLDER / "Containerfile").read_text(encoding="utf-8")),
        flags=re.MULTILINE,
    )[1:]
]


def given(instruction: str, stage: int = -1) -> list[str]:
    return [rest for name, rest in STAGES[stage] if name == instruction]


def test_bases_are_slim_and_pinned_and_name_no_registry() -> None:
    assert [stage[0][1].split()[0] for stage in STAGES] == ["${BUILD_BASE}", "${BASE}"]
    text = (FOLDER / "Containerfile").read_text(encoding="utf-8")
    bases = dict(re.findall(r"^ARG (BUILD_BASE|BASE)=(.+)$", text, re.MULTILINE))
    assert len(set(bases.values())) == 1
    assert re.fullmatch(r"python:3\.\d+\.\d+-slim-\w+", bases["BASE"])
    # The add-on is built on it, too, under the name that the Supervisor takes.
    addon = ROOT / "deploy" / "home-assistant" / "addon" / "thermogate"
    built = yaml.safe_load((addon / "build.yaml").read_text(encoding="utf-8"))["build_from"]
    assert set(built.values()) == {f"library/{bases['BASE']}"}
    version = tuple(map(int, re.findall(r"\d+", bases["BASE"])[:2]))
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    assert version >= tuple(map(int, re.findall(r"\d+", wanted)))


def test_it_runs_as_nobody_in_particular_and_writes_into_volumes_of_its_own() -> None:
    (user,) = given("USER")
    assert re.fullmatch(r"[1-9]\d{3,}:[1-9]\d{3,}", user)
    names = [name for name, _ in STAGES[-1]]
    assert "RUN" not in names[names.index("USER") :]
    assert not any(word in line for line in given("RUN") for word in ("sudo", "curl", "apt"))
    state, cache = json.loads(given("VOLUME")[0])
    assert f"XDG_CACHE_HOME={Path(cache).parent}" in given("ENV")[0].split()
    assert any(f"--chown={user}" in line and cache in line for line in given("COPY"))
    assert any(f"-o {user.replace(':', ' -g ')}" in line and state in line for line in given("RUN"))
    assert {state, cache} < {volume.split(":")[1] for volume in SERVICE["volumes"]}


def test_commands_of_the_image_are_commands() -> None:
    from service.cli.main import _parser

    entry, command = json.loads(given("ENTRYPOINT")[0]), json.loads(given("CMD")[0])
    assert entry == ["thermogate"]
    parsed = _parser().parse_args(command)
    assert tomllib.loads(parsed.overrides[0])["site"]["state_dir"] == "/var/lib/thermogate"
    check = json.loads(re.search(r"CMD (\[.*\])", given("HEALTHCHECK")[0])[1])  # type: ignore[index]
    assert check[0] == "thermogate"
    assert _parser().parse_args(check[1:]).alive
    assert given("STOPSIGNAL") == ["SIGTERM"]


def test_what_is_copied_is_there_and_not_ignored() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    for line in given("COPY", 0):
        *sources, _ = line.split()
        for source in sources:
            assert (ROOT / source).exists(), source
            assert f"!{source}" in ignored, source


def test_what_it_leaves_out_is_there_to_be_left_out() -> None:
    """A library that is renamed would fail the build of the image, far from here."""
    (stripped,) = (line for line in given("RUN", 0) if "strip --strip-unneeded" in line)
    libraries = stripped.split("--strip-unneeded")[1].split()
    installed = Path(llvmlite.__file__).parents[1]
    assert libraries
    assert [library for library in libraries if not (installed / library).is_file()] == []
    (pruned,) = (line for line in given("RUN", 0) if "-name tests -prune" in line)
    unused = re.search(r"rm -r (.+?) &&", pruned)[1].split()  # type: ignore[index]
    assert [one for one in unused if not (installed / one).exists()] == []
    hashed, *more = (line for line in given("RUN", 0) if "python install" in line)
    assert "--require-hashes" in hashed
    assert all("--no-compile" in line for line in (hashed, *more))


def test_the_composition_takes_everything_away() -> None:
    assert (SERVICE["read_only"], SERVICE["cap_drop"]) == (True, ["ALL"])
    assert "no-new-privileges:true" in SERVICE["security_opt"]
    assert re.search(r":(?!latest$)", SERVICE["image"])
    # A port of the machine would lead to a daemon that listens beyond loopback.
    assert not SERVICE.keys() & {"privileged", "ports"}
    assert (FOLDER / SERVICE["build"]["context"] / SERVICE["build"]["dockerfile"]).samefile(FOLDER / "Containerfile")


def _private_mounts() -> bool:
    if os.geteuid() != 0 or not all(map(shutil.which, ("unshare", "setpriv", "mount"))):
        return False
    probe = ["unshare", "--mount", "mount", "-o", "remount,bind,ro", "/"]
    return subprocess.run(probe, capture_output=True, timeout=10, check=False).returncode == 0


@pytest.mark.skipif(not _private_mounts(), reason="needs root, unshare and setpriv to make a read-only root")
def test_the_daemon_runs_on_a_read_only_root_without_any_capability(tmp_path: Path) -> None:
    state, cache = tmp_path / "lib", tmp_path / "cache"
    config = tmp_path / "thermogate.toml"
    config.write_text((EXAMPLES / "generic-csv.toml").read_text().replace("data/", f"{EXAMPLES}/data/"))
    for folder in (state, cache):
        folder.mkdir()
    prepare = [
        "mount --make-rprivate /",
        *(f"mount -t tmpfs tmpfs {folder}" for folder in (state, cache)),
        # Every mount there is, but for those two and the kernel's own.
        "grep -E ' (ext4|overlay|xfs|btrfs|tmpfs|fuse|9p|virtiofs)' /proc/mounts | cut -d' ' -f2 "
        f"| grep -v '^{tmp_path}' | while read m; do mount -o remount,bind,ro $m; done",
        f"if touch {ROOT}/written {tmp_path}/written 2>/dev/null; then echo 'the root can be written'; exit 9; fi",
        "exec setpriv --no-new-privs --bounding-set=-all --inh-caps=-all "
        f"{THERMOGATE} run {config} --set 'site.state_dir=\"{state}\"' --set http.port=0 --set zenoh.enabled=false "
        "--set 'zones.room-1.estimator=\"ekf\"'",
    ]
    # Compiling the kernels, which takes a while, is a matter of the systemd unit's test.
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "HOME": "/nonexistent", "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"NUMBA_DISABLE_JIT": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    command = ["unshare", "--mount", "sh", "-ec", "\n".join(prepare)]
    with Program(command, tmp_path / "log", env=environment) as daemon:
        url = daemon.says(r"serving on (\S+)", 600)[1]
        daemon.wait_for(lambda: ask(f"{url}/zones")[1]["zones"][0]["samples"], 600)
        status = Path(f"/proc/{daemon.process.pid}/status").read_text()
        assert re.search(r"CapEff:\s+0+$", status, re.MULTILINE)
        assert re.search(r"NoNewPrivs:\s+1$", status, re.MULTILINE)
        done = thermogate("health", "--alive", "--url", url)
        assert (done.returncode, done.stdout[:5]) == (0, "OK - ")
        assert daemon.terminate() == 0
