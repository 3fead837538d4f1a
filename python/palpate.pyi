"""Calibrates tactile sensors: runs on a rig, their presses as arrays, and the place and force of unknown contacts.

Places are in mm, forces in N, times in s; names end with the unit. The functions take the options of the commands of the same
name.
"""

from collections.abc import Iterator, Sequence
from os import PathLike
from types import TracebackType
from typing import Any, ClassVar, Literal, TypeAlias, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str
__commit__: str | None

_Path: TypeAlias = str | PathLike[str]
_Reading: TypeAlias = Sequence[float] | np.ndarray[tuple[int], np.dtype[np.floating[Any]]]
_Batch: TypeAlias = Sequence[Sequence[float]] | np.ndarray[tuple[int, int], np.dtype[np.floating[Any]]]
_Verdict: TypeAlias = Literal["ok", "weak-signal", "outside-area", "not-one-contact", "channel-fault", "unsolved"]

class Error(Exception):
    """A command failed. `code` is the exit code of the command line."""

    code: ClassVar[int]

class UsageError(Error):
    """Bad recipe, rig, table or option; nothing moved. Code 2."""

class DeviceError(Error):
    """A device failed. Code 3."""

class TripError(Error):
    """A safety rule was broken. Code 4."""

class RecordError(Error):
    """A result couldn't be recorded. Code 5."""

@final
class Frame:
    """A table: columns of one length, each with its unit and its definition.

    `frame["x_mm"]` and `frame.x_mm` are a column as a numpy array, shape (rows,), which can't be written to. A missing number is
    NaN. The frame gives its memory to polars, pyarrow and pandas without a copy, for example `polars.DataFrame(frame)` and
    `pandas.DataFrame.from_arrow(frame)`. A missing value is null there.
    """

    @property
    def name(self) -> str:
        """Name of the table, such as `presses`."""
    @property
    def columns(self) -> list[str]:
        """Names of the columns, in order."""
    @property
    def units(self) -> dict[str, str]:
        """Unit of each column, by name; empty if it has none."""
    @property
    def definitions(self) -> dict[str, str]:
        """Definition of each column, by name, in a sentence."""
    @property
    def outputs(self) -> NDArray[np.float64]:
        """The columns out_1 to out_n as one array, shape (rows, n), in the array's unit."""
    def keys(self) -> list[str]:
        """Names of the columns, in order."""
    def __len__(self) -> int: ...
    def __contains__(self, name: str, /) -> bool: ...
    def __getitem__(self, name: str, /) -> NDArray[Any]: ...
    def __getattr__(self, name: str, /) -> NDArray[Any]: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """The frame as a stream of Arrow record batches, without a copy of its numbers."""

@final
class Run:
    """A run, or the presses of a table."""

    @property
    def path(self) -> PathLike[str]:
        """The run folder or the table."""
    @property
    def manifest(self) -> dict[str, Any] | None:
        """The manifest of a run: recipe, labels, devices, programs; None for a table."""
    @property
    def notes(self) -> list[str]:
        """Lines that `palpate fit` prints about the files."""
    @property
    def presses(self) -> Frame:
        """The presses, a row for each level: the columns of `presses.csv`."""
    @property
    def calibration_matrix(self) -> Frame | None:
        """The outputs at the places of the calibration; None without them."""
    @property
    def test_matrix(self) -> Frame | None:
        """The outputs at the places of the test; None without them."""
    @property
    def characteristics(self) -> Frame | None:
        """Repeatability, hysteresis and linearity of each unit; None without staircases."""
    @property
    def truth(self) -> Frame | None:
        """The true values of a simulated run; None otherwise."""
    @property
    def frames(self) -> dict[str, Frame]:
        """All frames, by name."""
    def __len__(self) -> int: ...

@final
class Contact:
    """The contact behind one reading. An unknown number is NaN."""

    @property
    def x_mm(self) -> float:
        """x of the contact, specimen frame, mm."""
    @property
    def y_mm(self) -> float:
        """y of the contact, specimen frame, mm."""
    @property
    def force_n(self) -> float:
        """Force of the contact, N; NaN if the calibration has no forces."""
    @property
    def sd_x_mm(self) -> float:
        """Standard deviation of x, mm."""
    @property
    def sd_y_mm(self) -> float:
        """Standard deviation of y, mm."""
    @property
    def sd_force_n(self) -> float:
        """Standard deviation of the force, N."""
    @property
    def half68_mm(self) -> float:
        """Half-width that contains 68 % of the location errors, mm."""
    @property
    def half95_mm(self) -> float:
        """Half-width that contains 95 % of the location errors, mm."""
    @property
    def half68_n(self) -> float:
        """Half-width that contains 68 % of the force errors, N."""
    @property
    def half95_n(self) -> float:
        """Half-width that contains 95 % of the force errors, N."""
    @property
    def other_x_mm(self) -> float:
        """x of another place that fits nearly as well, mm."""
    @property
    def other_y_mm(self) -> float:
        """y of another place that fits nearly as well, mm."""
    @property
    def misfit(self) -> float:
        """Misfit between the reading and one contact; above 1: not a single contact."""
    @property
    def relative_force(self) -> float:
        """Force relative to the typical press of a calibration without forces."""
    @property
    def half68_relative_force(self) -> float:
        """Half-width that contains 68 % of the errors of the relative force."""
    @property
    def half95_relative_force(self) -> float:
        """Half-width that contains 95 % of the errors of the relative force."""
    @property
    def depth_mm(self) -> float:
        """Depth of the contact, mm; NaN unless the calibration is by depth."""
    @property
    def sd_depth_mm(self) -> float:
        """Standard deviation of the depth, mm."""
    @property
    def half68_depth_mm(self) -> float:
        """Half-width that contains 68 % of the depth errors, mm."""
    @property
    def half95_depth_mm(self) -> float:
        """Half-width that contains 95 % of the depth errors, mm."""
    @property
    def is_calibrated_load(self) -> bool:
        """Whether the answer assumes the load of the calibration, which the reading has; only if a second method is fitted for it."""
    @property
    def verdict(self) -> _Verdict:
        """Whether the contact is credible."""
    @property
    def unit(self) -> int | None:
        """The output that contradicts the others, counted from 1, if the verdict is `channel-fault`."""
    @property
    def error(self) -> str | None:
        """Why there is no contact, if the verdict is `unsolved`."""

@final
class Model:
    """A calibrated sensor: a method that is fitted to presses."""

    @staticmethod
    def load(path: _Path) -> Model:
        """Loads a sensor file, which `save` or `palpate fit` wrote."""
    def save(self, path: _Path) -> None:
        """Writes the model to a sensor file. Replaces a sensor file, but nothing else."""
    @overload
    def solve(self, readings: _Reading) -> Contact: ...
    @overload
    def solve(self, readings: _Batch) -> Frame: ...
    @overload
    def solve(self, readings: ArrayLike) -> Any:
        """Solves one reading, shape (outputs,), or a batch, shape (rows, outputs). A missing output is NaN.

        Readings are the outputs minus those without load, in the unit of the calibration. One reading gives a `Contact`, a batch a
        `Frame` with a row for each reading and the attributes of a `Contact` as columns (unit is 0 if there is none). The numbers
        are those of `palpate solve`, to the last bit. Each call is a session of its own: an output that breaks within a batch is
        excluded from the rest of the batch. Other threads continue meanwhile.
        """
    def session(self) -> Session:
        """Begins a session: one reading after another, where an output that breaks is excluded from then on."""
    @property
    def solver(self) -> str:
        """Name of the method."""
    @property
    def sensor(self) -> str | None:
        """ID of the sensor; None if its run has none."""
    @property
    def outputs(self) -> int:
        """Number of outputs of a reading."""
    @property
    def broken(self) -> list[int]:
        """Outputs that are excluded, counted from 1."""
    @property
    def x_mm(self) -> tuple[float, float]:
        """Smallest and largest x of the calibration, mm."""
    @property
    def y_mm(self) -> tuple[float, float]:
        """Smallest and largest y of the calibration, mm."""
    @property
    def force_n(self) -> tuple[float, float] | None:
        """Smallest and largest force of the calibration, N; None if forces are relative."""
    @property
    def depth_mm(self) -> tuple[float, float] | None:
        """Smallest and largest depth of the calibration, mm; None unless presses are known by depth."""

@final
class Session:
    """One reading after another of one sensor. An output that breaks is excluded from then on."""

    @overload
    def solve(self, readings: _Reading) -> Contact: ...
    @overload
    def solve(self, readings: _Batch) -> Frame: ...
    @overload
    def solve(self, readings: ArrayLike) -> Any:
        """Solves the next reading, shape (outputs,), or the next batch, shape (rows, outputs), as `Model.solve` does."""
    @property
    def is_out_of_date(self) -> bool:
        """Whether so many contacts didn't fit the calibration that the sensor should be calibrated again."""
    @property
    def broken(self) -> list[int]:
        """Outputs that are excluded, counted from 1."""
    @property
    def at_fault(self) -> dict[int, float]:
        """Outputs at fault since the calibration, counted from 1, which are excluded: each with the odds to one that it is at fault."""

@final
class Events(Iterator[dict[str, Any]]):
    """The events of a run, an iterator of dicts.

    A press that is on disk is the dict of a line of `palpate run --json`: press, level, phase, x_mm, y_mm (mm), force_n (N), t_s
    (s), out_1 to out_n (the array's unit), ... Every press is there, however slowly the events are taken, and the run never
    waits.

    Other events have the key `event`: `ready` (devices), `begins` (press, phase), `retouched` (x_mm, y_mm, before_mm,
    touched_mm), `rests` (rest_s), and at the end `ended` (status: complete or stopped; out). Events about the progress, which
    are all but the last, are lost if they aren't taken.

    The iterator raises `DeviceError`, `TripError` or `RecordError` if the run fails. The run is stopped and the stage is parked
    when the iterator is closed, leaves its `with` block or is deleted, and when Python ends. No signal handler is installed:
    Ctrl-C raises KeyboardInterrupt, as anywhere in Python.
    """

    @property
    def out(self) -> PathLike[str]:
        """The folder of the run."""
    @property
    def planned(self) -> int:
        """Number of presses of the plan."""
    @property
    def force_n(self) -> float:
        """Latest reading of the load cell, N, relative to its zero."""
    def stop(self) -> None:
        """Stops the run after the press under way. The remaining events still follow."""
    def close(self) -> None:
        """Stops the run at once, and returns when the stage is parked. No event follows."""
    def __iter__(self) -> Events: ...
    def __next__(self) -> dict[str, Any]: ...
    def __enter__(self) -> Events: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

@final
class Evaluation:
    """Errors of methods on test presses, and the verdict: the objects of `palpate evaluate --json`."""

    @property
    def methods(self) -> dict[str, dict[str, Any]]:
        """The evaluation of each method, by its name: a dict of the errors."""
    @property
    def failures(self) -> dict[str, str]:
        """Why a method has no evaluation, by its name."""
    @property
    def cross_validated(self) -> list[dict[str, Any]] | None:
        """The errors on presses that were held out in turn, the best method first, if there is no test; None otherwise."""
    @property
    def verdict(self) -> Literal["accepted", "not-accepted", "not-decided"] | None:
        """The verdict; None without a rule."""
    @property
    def judgement(self) -> dict[str, Any] | None:
        """The verdict with each limit; None without a rule."""

@final
class VectorContact:
    """The contact behind one reading, with its force vector. An unknown number is NaN."""

    @property
    def x_mm(self) -> float:
        """x of the contact, specimen frame, mm."""
    @property
    def y_mm(self) -> float:
        """y of the contact, specimen frame, mm."""
    @property
    def force_x_n(self) -> float:
        """Force along x, N; NaN if the outputs can't show it."""
    @property
    def force_y_n(self) -> float:
        """Force along y, N; NaN if the outputs can't show it."""
    @property
    def force_n(self) -> float:
        """Force into the specimen, N."""
    @property
    def sd_x_mm(self) -> float:
        """Standard deviation of x, mm."""
    @property
    def sd_y_mm(self) -> float:
        """Standard deviation of y, mm."""
    @property
    def sd_force_x_n(self) -> float:
        """Standard deviation of the force along x, N."""
    @property
    def sd_force_y_n(self) -> float:
        """Standard deviation of the force along y, N."""
    @property
    def sd_force_n(self) -> float:
        """Standard deviation of the force into the specimen, N."""
    @property
    def shear_bound_n(self) -> float:
        """Expected error of a force along the surface that the outputs can't show, N."""
    @property
    def second_x_mm(self) -> float:
        """x of a second contact, specimen frame, mm."""
    @property
    def second_y_mm(self) -> float:
        """y of a second contact, specimen frame, mm."""
    @property
    def second_force_n(self) -> float:
        """Force of a second contact, N."""
    @property
    def misfit(self) -> float:
        """Misfit between the reading and one contact; above 1: not a single contact."""
    @property
    def verdict(self) -> str:
        """Whether the contact is credible, or what the reading is instead."""
    @property
    def unit(self) -> int | None:
        """The taxel that contradicts the others, counted from 1, if the verdict is `unit-fault`."""
    @property
    def error(self) -> str | None:
        """Why there is no contact, if the verdict is `unsolved`."""

@final
class VectorModel:
    """A calibrated sensor that solves places and force vectors."""

    @staticmethod
    def load(path: _Path) -> VectorModel:
        """Loads a sensor file, which `save` or `palpate fit --vector` wrote."""
    def save(self, path: _Path) -> None:
        """Writes the model to a sensor file. Replaces a sensor file, but nothing else."""
    @overload
    def solve(self, readings: _Reading) -> VectorContact: ...
    @overload
    def solve(self, readings: _Batch) -> Frame: ...
    @overload
    def solve(self, readings: ArrayLike) -> Any:
        """Solves one reading, shape (outputs,), or a batch, shape (rows, outputs). A missing output is NaN.

        One reading gives a `VectorContact`, a batch a `Frame` with the attributes of a `VectorContact` as columns (unit is 0 if there
        is none). The numbers are those of `palpate solve`, to the last bit. Other threads continue meanwhile.
        """
    @property
    def sensor(self) -> str | None:
        """ID of the sensor; None if its run has none."""
    @property
    def outputs(self) -> int:
        """Number of outputs of a reading."""
    @property
    def x_mm(self) -> tuple[float, float]:
        """Smallest and largest x of the calibration, mm."""
    @property
    def y_mm(self) -> tuple[float, float]:
        """Smallest and largest y of the calibration, mm."""
    @property
    def knows_shear(self) -> bool:
        """Whether the calibration shows the effect of a force along the surface."""

def load(run: _Path, *, columns: str | None = None) -> Run:
    """Loads a run folder or a table of presses.

    `columns` states what the columns of a table contain: a columns file, or a short form such as
    `x_mm=X,y_mm=Y,outputs=ch0..ch15`. Raises `UsageError` if the path is no run or table, or is damaged.
    """

def fit(
    run: Run | _Path | list[Run | _Path],
    solver: str = "best",
    *,
    constant_load: bool = False,
    common_offset: bool = False,
    false_alarms: float | None = None,
    forces_n: tuple[float, float] | None = None,
    columns: str | None = None,
    quantity: Literal["force", "depth"] | None = None,
) -> Model:
    """Fits a method to a run or a table of presses, like `palpate fit`; to a list, one for each sensor of a design, one map.

    `solver` is the name of a method; `best` selects by cross-validation. `constant_load`: every contact has the force of the
    calibration. `common_offset`: solve also for an offset that all outputs share. `false_alarms`: accepted share of single
    contacts with a wrong verdict (0.01). `forces_n`: the expected forces (least, most), N, if the calibration has one force.
    `columns`: what the columns of a table contain. `quantity`: what is solved besides the place; without it the force, or the depth
    if only depths are known. Forces are those of the load cell.
    """

def fit_vector(run: Run | _Path, *, columns: str | None = None) -> VectorModel:
    """Fits a run or a table of presses and drags, like `palpate fit --vector`.

    `columns`: what the columns of a table contain. Raises `UsageError` if no press has three components of the force.
    """

def run(
    recipe: _Path,
    rig: _Path | None = None,
    out: _Path | None = None,
    *,
    seed: int = 1,
    simulate: bool = False,
    strategy: Literal["guarded", "velocity", "map"] | None = None,
    presses_max: int | None = None,
    sensor: str | None = None,
    design: str | None = None,
    batch: str | None = None,
    mounting: str | None = None,
    operator: str | None = None,
    note: str | None = None,
    pace: float | None = None,
    durability: Literal["full", "fast"] | None = None,
    confirmed: Sequence[Literal["down", "home", "clear"]] = (),
) -> Events:
    """Runs a recipe on a rig and records every press, like `palpate run`. Returns the events.

    `recipe` and `rig` are files, or names of shipped ones; without a rig it is that of the recipe's key `rig`, or `rig.toml` in its
    folder, and must be simulated. `out` is the folder of the run [runs/NAME]. `simulate` replaces the rig's links by emulators.
    The other options are those of `palpate run`. `confirmed` is what a person has made sure of; the run never asks. Raises `UsageError` for bad input; nothing has moved then.
    """

def resume(
    run: _Path,
    rig: _Path | None = None,
    *,
    after_trip: bool = False,
    sound: Literal["outputs-differ"] | None = None,
    from_here: bool = False,
    pace: float | None = None,
    durability: Literal["full", "fast"] | None = None,
    confirmed: Sequence[Literal["down", "home", "clear"]] = (),
) -> Events:
    """Continues a run that was stopped, like `palpate resume`. Returns the events of the remaining presses.

    `rig` is the rig to continue with: links and commands of processes may differ, limits may be tighter. `after_trip` continues
    after a safety trip, once you have found its cause. `sound` repeats and flags a press that this rule stopped falsely; with
    `from_here` it compares no later press. The events of a complete run are only `ended`. Raises `UsageError` for bad input; nothing
    has moved then.
    """

def evaluate(
    run: Run | _Path,
    test: _Path | None = None,
    solver: str = "best",
    *,
    constant_load: bool = False,
    holdout: tuple[Literal["places", "press", "time"], float] | None = None,
    seed: int = 1,
    same_place: float | None = None,
    save: _Path | None = None,
    columns: str | None = None,
    accept: _Path | None = None,
    quantity: Literal["force", "depth"] | None = None,
) -> Evaluation:
    """Solves the test presses of a run, of two tables, or held out of one, and judges them, like `palpate evaluate`.

    `solver` is the name of a method; `best` selects by cross-validation, `all` evaluates every method. `holdout` holds out presses
    as the test, and their share: ("places", 0.2). `seed` selects them, `same_place` (mm) is the largest distance of presses at one
    place, and `save` is a folder for both parts. `accept` is a file with the acceptance rule that replaces the recipe's.
    """

def report(
    *runs: Run | _Path,
    out: _Path | None = None,
    figures: _Path | None = None,
    compare: bool = False,
    same_sensor: bool = False,
    accept: _Path | None = None,
    solver: str | None = None,
) -> dict[str, Any]:
    """Writes a page about one run, about runs of one sensor, or a comparison of many sensors, like `palpate report`.

    Returns the object of `palpate report --json`: page, figures and result.
    """

def certificate(
    *runs: Run | _Path,
    given: _Path,
    out: _Path | None = None,
    same_sensor: bool = False,
    accept: _Path | None = None,
) -> dict[str, Any]:
    """Writes the calibration certificate of a sensor, like `palpate certificate`: a page and a Digital Calibration Certificate.

    `given` is the TOML file with laboratory, customer, item and procedure. Returns the object of `palpate certificate --json`:
    result, files and verdict. Replaces no file.
    """

def simulate(
    recipe: _Path | None = None, rig: _Path | None = None, out: _Path | None = None, *, seed: int = 1
) -> Run:
    """Simulates a calibration and returns its run: the shipped recipe `calibrate` on the simulated rig `sim`, if no others are
    given. `out` is the folder of the run [runs/NAME]."""
