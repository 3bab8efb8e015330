"""The datagrams that systemd would read, on sockets of our own."""

import os
import socket

import pytest

from service.daemon.notify import Notifier


@pytest.fixture
def manager(tmp_path):
    """A socket as systemd has it, and the environment that names it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setblocking(False)
        yield listener, {"NOTIFY_SOCKET": str(tmp_path / "notify")}


def told(listener):
    return listener.recv(4096).decode().splitlines()


def test_every_message_is_one_datagram_of_assignments(manager):
    listener, environment = manager
    notifier = Notifier(environment)
    notifier.starting("restoring 3 zones", 90)
    assert told(listener) == ["STATUS=restoring 3 zones", "EXTEND_TIMEOUT_USEC=90000000"]
    notifier.ready("serving")
    assert told(listener) == ["READY=1", "STATUS=serving"]
    notifier.reloading()
    state, moment = told(listener)
    assert state == "RELOADING=1"
    assert moment.removeprefix("MONOTONIC_USEC=").isdecimal()
    notifier.alive()
    assert told(listener) == ["WATCHDOG=1"]
    notifier.stopping()
    assert told(listener)[0] == "STOPPING=1"


def test_abstract_sockets():
    name = f"thermogate-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(f"\0{name}")
        listener.setblocking(False)
        Notifier({"NOTIFY_SOCKET": f"@{name}"}).alive()
        assert told(listener) == ["WATCHDOG=1"]


@pytest.mark.parametrize(
    ("variables", "watchdog"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "30000000"}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid())}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_is_ours_or_nobodys(manager, variables, watchdog):
    assert Notifier(manager[1] | variables).watchdog == watchdog


def test_a_manager_that_is_not_there_gone_or_deaf_does_not_stop_the_daemon(manager, tmp_path, caplog):
    listener, environment = manager
    Notifier({}).ready("serving")
    assert Notifier({"WATCHDOG_USEC": "30000000"}).watchdog is None
    assert not caplog.records
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "nowhere")}).alive()
    assert "systemd cannot be told WATCHDOG=1" in caplog.text
    caplog.clear()
    notifier = Notifier(environment)
    # Nobody reads: the queue of the socket is full after some, and no call waits.
    for _ in range(2000):
        notifier.alive()
    assert "systemd cannot be told" in caplog.text
    assert told(listener) == ["WATCHDOG=1"]
