"""One run of EnergyPlus on a thread of its own, which stops at the beginning of every step and waits for its caller.

EnergyPlus calls back; a controller wants to call. Two queues of length one turn the one into the other.
"""

import ctypes
import json
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from replay.energyplus.epjson import Model
from replay.energyplus.library import Callback, library
from replay.errors import ReplayError

_RUN_PERIOD_OF_WEATHER = 3
_STOP_SECONDS = 30.0

Values = Sequence[float]


class EnergyPlusError(ReplayError):
    """EnergyPlus has given up; the text is what it says about it."""


class Variable(NamedTuple):
    """An output of EnergyPlus: its type, such as "Zone Mean Air Temperature", and whose it is."""

    type: str
    key: str


class Actuator(NamedTuple):
    """An input of EnergyPlus: the kind of object, what of it is set, and its name."""

    kind: str
    control: str
    key: str


Controller = Callable[[Values], Values]
"""From the values of all variables to those of all actuators."""


class Engine:
    """A model run step by step: `first` holds the values at its first step, `step` goes to the next one. At every step
    the `variables` are read, rates of the step before and the weather to come, and then the `actuators` set for the
    step to come; `warm_up` sets them while EnergyPlus repeats the first day until the building has settled."""

    def __init__(
        self,
        model: Model,
        weather: Path,
        variables: Sequence[Variable],
        actuators: Sequence[Actuator],
        warm_up: Controller,
    ) -> None:
        self._library = library()
        self._variables, self._actuators, self._warm_up = tuple(variables), tuple(actuators), warm_up
        self._handles: tuple[list[int], list[int]] | None = None
        self._read: SimpleQueue[Values | BaseException] = SimpleQueue()
        self._set: SimpleQueue[Values | None] = SimpleQueue()
        self._stopping = self._ended = False
        self._folder = tempfile.TemporaryDirectory(prefix="thermogate-energyplus-")
        self._thread = threading.Thread(target=self._run, args=(model, weather), name="energyplus", daemon=True)
        self._thread.start()
        try:
            self.first = self._next()
        except BaseException:
            self.close()
            raise

    def step(self, values: Values) -> Values:
        """Set the actuators, live one step, and read the variables. EnergyPlusError if that cannot be done."""
        if self._ended:
            raise EnergyPlusError("this run of EnergyPlus has ended; begin another one")
        self._set.put(values)
        return self._next()

    def close(self) -> None:
        """End the run; nothing more can be asked of it."""
        self._ended = True
        self._set.put(None)
        self._thread.join(_STOP_SECONDS)
        self._folder.cleanup()

    def _next(self) -> Values:
        read = self._read.get()
        if isinstance(read, BaseException):
            self._ended = True
            raise read
        return read

    def _run(self, model: Model, weather: Path) -> None:
        """The life of the thread. Whatever ends it, the caller learns of it."""
        folder = Path(self._folder.name)
        try:
            self._simulate(model, weather, folder)
        except BaseException as error:
            self._read.put(error)
        else:
            self._read.put(EnergyPlusError(_said(folder / "eplusout.err")))

    def _simulate(self, model: Model, weather: Path, folder: Path) -> None:
        source = folder / "in.epJSON"
        try:
            source.write_text(json.dumps(model), encoding="utf-8")
        except OSError as error:
            raise EnergyPlusError(f"{source}: cannot be written ({error.strerror}); make room, or set TMPDIR") from None
        words = ("energyplus", "-w", str(weather), "-d", str(folder), str(source))
        arguments = (ctypes.c_char_p * len(words))(*(word.encode() for word in words))
        # Kept here: ctypes does not hold it.
        callback = Callback(self._begin_step)
        with _computing:
            state = self._library.stateNewPython()
            try:
                self._library.setConsoleOutputState(state, 0)
                self._library.callbackBeginZoneTimeStepBeforeInitHeatBalance(state, callback)
                for variable in self._variables:
                    self._library.requestVariable(state, variable.type.encode(), variable.key.encode())
                self._library.energyplus(state, len(words), arguments)
            finally:
                self._library.stateDelete(state)

    def _begin_step(self, state: int) -> None:
        """Called by EnergyPlus, which would swallow an exception."""
        if self._stopping or not self._library.apiDataFullyReady(state):
            return
        if self._library.kindOfSim(state) != _RUN_PERIOD_OF_WEATHER:
            return
        try:
            self._exchange(state)
        except BaseException as error:
            self._read.put(error)
            self._stop(state)

    def _exchange(self, state: int) -> None:
        variables, actuators = self._handles = self._handles or self._found(state)
        values = [self._library.getVariableValue(state, handle) for handle in variables]
        wanted: Values | None
        warming_up = bool(self._library.warmupFlag(state))
        with _paused():
            if warming_up:
                wanted = self._warm_up(values)
            else:
                self._read.put(values)
                wanted = self._set.get()
        if wanted is None:
            self._stop(state)
            return
        for handle, value in zip(actuators, wanted, strict=True):
            self._library.setActuatorValue(state, handle, value)

    def _found(self, state: int) -> tuple[list[int], list[int]]:
        """The handles of variables and actuators; EnergyPlusError for one that the model does not have."""
        lookups = (
            (self._library.getVariableHandle, self._variables),
            (self._library.getActuatorHandle, self._actuators),
        )
        variables, actuators = (
            {name: find(state, *(text.encode() for text in name)) for name in names} for find, names in lookups
        )
        missing = [", ".join(name) for name, handle in (variables | actuators).items() if handle < 0]
        if missing:
            raise EnergyPlusError(f"the model has no {missing[0]}; its building does not fit what is asked of it")
        return list(variables.values()), list(actuators.values())

    def _stop(self, state: int) -> None:
        self._stopping = True
        self._library.stopSimulation(state)


_computing = threading.Lock()
"""Held by the run that computes: EnergyPlus keeps some variables that all runs of a process share."""


@contextmanager
def _paused() -> Iterator[None]:
    """Let other runs compute while this one waits."""
    _computing.release()
    try:
        yield
    finally:
        _computing.acquire()


def _said(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    severe = [line.split("**", 2)[-1].strip() for line in lines if "** Severe" in line or "**  Fatal" in line]
    return f"EnergyPlus has ended: {severe[0]}" if severe else "EnergyPlus has ended before it was asked to"
