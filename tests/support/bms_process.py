"""`thermogate simulate-bms` as a process, for tests to read, to break, and to point the daemon at."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

from support.harness import THERMOGATE, ask
from support.processes import Program, fetch


class Bms(Program):
    """A simulated BMS that has greeted."""

    def __init__(self, *arguments: object) -> None:
        self._folder = TemporaryDirectory()
        command = [THERMOGATE, "simulate-bms", "--port", 0, "--control-port", 0, *arguments]
        super().__init__(command, Path(self._folder.name) / "log")
        self.says("Ctrl-C")
        self.port = int(self.says(r"Modbus TCP +127\.0\.0\.1:(\d+)")[1])
        self.control = self.says(r"Control +(http://\S+);")[1]

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._folder.cleanup()

    def get(self, path: str) -> dict:
        return ask(self.control + path)[1]

    def break_down(self, kind: str, device: str, **more: object) -> None:
        """Begin a fault."""
        body = json.dumps({"kind": kind, "device": device} | more).encode()
        status, answer = ask(f"{self.control}/faults", body, Content_Type="application/json")
        assert status < 300, answer

    def mend(self) -> None:
        """End every fault."""
        assert fetch(f"{self.control}/faults", method="DELETE")[0] == 204
