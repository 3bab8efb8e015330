"""`thermogate simulate-bms` as a process, for tests to read, to break, and to point the daemon at."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from support.harness import THERMOGATE, ask


class Bms:
    """A running simulated BMS."""

    def __init__(self, process: subprocess.Popen[str], greeting: str) -> None:
        self.process, self.greeting = process, greeting
        self.port = int(re.search(r"Modbus TCP +127\.0\.0\.1:(\d+)", greeting)[1])  # type: ignore[index]
        self.control = re.search(r"Control +(http://\S+);", greeting)[1]  # type: ignore[index]

    def post(self, path: str, body: dict[str, object]) -> dict[str, object]:
        status, answer = ask(self.control + path, json.dumps(body).encode(), Content_Type="application/json")
        assert status < 300, answer
        return answer


@contextmanager
def simulated(*arguments: object) -> Iterator[Bms]:
    command = [str(THERMOGATE), "simulate-bms", "--port", "0", "--control-port", "0", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        lines: list[str] = []
        while not lines or "Ctrl-C" not in lines[-1]:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            lines.append(line)
        yield Bms(process, "".join(lines))
    finally:
        process.kill()
        process.communicate()
