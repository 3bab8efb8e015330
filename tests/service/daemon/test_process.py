"""What a process of ours is set to before it computes."""

import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from service.daemon import process

THREADS = "import os, numpy, scipy.linalg; print(len(os.listdir('/proc/self/task')))"


def threads(prepare, **environment):
    """How many threads a process has that has imported what computes."""
    clean = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", f"from service.daemon.process import prepare_process; {prepare}; {THREADS}"]
    return int(subprocess.run(command, env=clean | environment, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted in /proc")
def test_linear_algebra_starts_no_threads_of_its_own():
    assert threads("prepare_process()") == 1


@pytest.mark.skipif(not sys.platform.startswith("linux") or os.cpu_count() == 1, reason="there is nothing to start")
def test_whoever_wants_threads_or_owns_the_process_has_them():
    assert threads("prepare_process()", OPENBLAS_NUM_THREADS="2") > 1
    assert threads("prepare_process(shared=True)") > 1


NICENESS = """
import os, threading
from concurrent.futures import ThreadPoolExecutor
from service.daemon.process import stand_back

os.nice({niceness})
with ThreadPoolExecutor(1, initializer=stand_back) as computing:
    print(computing.submit(lambda: os.getpriority(os.PRIO_PROCESS, threading.get_native_id())).result())
print(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere all threads of a process have one priority")
@pytest.mark.parametrize("niceness", [0, 10])
def test_threads_that_compute_let_the_event_loop_go_first_whatever_the_priority_of_their_process(niceness):
    command = [sys.executable, "-c", NICENESS.format(niceness=niceness)]
    computing, looping = map(int, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    assert computing > looping


def test_an_account_without_a_home_compiles_into_a_folder_of_the_process(monkeypatch):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError("Could not determine home directory.")))
    # What it sets is taken back afterwards.
    monkeypatch.setattr(os, "environ", dict(os.environ))
    process._give_numba_a_cache()
    assert "thermogate-kernels-" in os.environ["NUMBA_CACHE_DIR"]
