"""The files of deploy/ray: what Ray and the command line themselves make of what is in them, as far as that needs no
cluster and no Kubernetes."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml
from support.harness import ROOT, THERMOGATE, thermogate

ray = pytest.importorskip("ray", reason="ray is not installed; say: make .venv/.fleet")

FOLDER = ROOT / "deploy" / "ray"
CLUSTER = yaml.safe_load((FOLDER / "cluster.yaml").read_text(encoding="utf-8"))
CAMPUS, SERVICE = yaml.safe_load_all((FOLDER / "kuberay.yaml").read_text(encoding="utf-8"))
HEAD = CAMPUS["spec"]["headGroupSpec"]
(WORKERS,) = CAMPUS["spec"]["workerGroupSpecs"]
CONTAINERS = [one for group in (HEAD, WORKERS) for one in group["template"]["spec"]["containers"]]

FIELDS = {
    "cluster": "gcsFaultToleranceOptions headGroupSpec workerGroupSpecs",
    "group": "groupName replicas minReplicas maxReplicas rayStartParams template",
    "container": "name image command env resources volumeMounts ports readinessProbe livenessProbe",
}
"""Those of a RayCluster (ray.io/v1) that the manifest needs."""


def options_of_start() -> set[str]:
    from ray.scripts.scripts import start

    return {option for parameter in start.params for option in parameter.opts}


def settings(environment: dict[str, str]) -> None:
    """Hold the settings of Ray to those that its programs know; one that is misspelled would have no effect."""
    folder = Path(ray.__file__).parent / "core" / "src" / "ray"
    known = b"".join((folder / name).read_bytes() for name in ("gcs/gcs_server", "raylet/raylet"))
    for name, value in environment.items():
        if re.match(r"RAY_[a-z]", name):
            assert name.removeprefix("RAY_").encode() in known, name
            assert value.isdecimal(), name
        else:
            assert name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_USAGE_STATS_ENABLED"), name


def test_the_cluster_file_is_what_ray_up_takes_with_commands_of_ray() -> None:
    pytest.importorskip("jsonschema", reason="Ray checks a cluster file with jsonschema")
    from ray.autoscaler._private.util import prepare_config, validate_config

    validate_config(prepare_config(CLUSTER))
    assert CLUSTER["min_workers"] == CLUSTER["max_workers"] == len(CLUSTER["provider"]["worker_ips"])
    for kind in ("head", "worker"):
        stop, start = CLUSTER[f"{kind}_start_ray_commands"]
        assert stop == "ray stop"
        words = shlex.split(start)
        begin = words.index("ray")
        settings(dict(word.split("=", 1) for word in words[:begin]))
        assert words[begin + 1] == "start"
        assert {word.split("=")[0] for word in words[begin + 2 :]} <= options_of_start()
        assert ("--head" in words) == (kind == "head")
        assert "RAY_AUTH_MODE=token" in words, "nobody else may start anything on the machines"


def test_the_manifest_is_one_of_a_ray_cluster() -> None:
    assert (CAMPUS["apiVersion"], CAMPUS["kind"]) == ("ray.io/v1", "RayCluster")
    assert set(CAMPUS["spec"]) == {*FIELDS["cluster"].split()}
    assert set(CAMPUS["spec"]["gcsFaultToleranceOptions"]) == {"redisAddress"}
    assert WORKERS["minReplicas"] <= WORKERS["replicas"] <= WORKERS["maxReplicas"]
    for group, port in ((HEAD, 6379), (WORKERS, int(WORKERS["rayStartParams"]["node-manager-port"]))):
        assert set(group) <= {*FIELDS["group"].split()}
        assert {f"--{name}" for name in group["rayStartParams"]} <= options_of_start()
        assert all(isinstance(value, str) for value in group["rayStartParams"].values()), "KubeRay takes strings only"
        # Where a probe is missing, KubeRay puts its own, which needs what the image lacks.
        container = group["template"]["spec"]["containers"][0]
        assert container["livenessProbe"]["tcpSocket"] == {"port": port}
        assert container["readinessProbe"].keys() & {"tcpSocket", "httpGet"}
        volumes = {volume["name"] for volume in group["template"]["spec"]["volumes"]}
        for container in group["template"]["spec"]["containers"]:
            assert set(container) <= {*FIELDS["container"].split()}
            settings({one["name"]: one.get("value", "") for one in container["env"] if "value" in one})
            assert {mount["name"] for mount in container["volumeMounts"]} == volumes
            assert all(mount["readOnly"] for mount in container["volumeMounts"])


def test_the_image_of_the_manifest_can_be_built_and_its_command_is_one_of_ours(tmp_path: Path) -> None:
    image = (ROOT / "deploy" / "container" / "Containerfile").read_text(encoding="utf-8")
    (usual,) = re.findall(r"^ARG EXTRAS=(\S+)$", image, re.MULTILINE)
    (wanted,) = re.findall(r"--build-arg EXTRAS=(\S+)", (FOLDER / "kuberay.yaml").read_text(encoding="utf-8"))
    known = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert {"fleet", *usual.split(",")} == set(wanted.split(",")) <= set(known)
    assert '"thermogate[${EXTRAS}] @' in image
    (command,) = [container["command"] for container in CONTAINERS if "command" in container]
    assert command[0] == THERMOGATE.name
    # It reads the configuration first; that there is none here is all that is wrong.
    done = thermogate(*(str(tmp_path / "site.toml") if word.startswith("/") else word for word in command[1:]))
    assert done.returncode != 0
    assert "site.toml" in done.stderr
    assert "usage" not in done.stderr


def test_the_service_finds_every_gateway() -> None:
    selector = SERVICE["spec"]["selector"]
    assert selector == {"ray.io/cluster": CAMPUS["metadata"]["name"], "ray.io/group": WORKERS["groupName"]}
    (container,) = WORKERS["template"]["spec"]["containers"]
    names = {port["name"] for port in container["ports"]}
    assert {port["targetPort"] for port in SERVICE["spec"]["ports"]} <= names
    probe = container["readinessProbe"]["httpGet"]
    assert (probe["path"], probe["port"] in names) == ("/healthz", True)
