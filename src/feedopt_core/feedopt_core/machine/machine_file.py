"""Machine files: axes, limits and the identified drive model.

No limit has a default. A limit of velocity, acceleration or jerk may be absent where something else that the file gives
bounds the motion: it is then infinity, and nothing is checked against it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from feedopt_core.arrays import FloatArray
from feedopt_core.config_files import find_config
from feedopt_core.errors import ConfigError

COORDINATES = ("x", "y", "z")
_ROOT = "/**"
_RESERVE = "tracking_error_reserve_mm"
_LIMITS = ("velocity_limit_mm_s", "acceleration_limit_mm_s2", "jerk_limit_mm_s3")


@dataclass(frozen=True)
class DriveModel:
    """Identified control signal ``u = inertia a + viscous v + offset + coulomb sign(v)``, V (thesis section 3.6.1).

    One entry an axis; ``v, a`` are the axis' own velocity and acceleration.
    """

    inertia_volts_s2_mm: tuple[float, ...]
    viscous_volts_s_mm: tuple[float, ...]
    offset_volts: tuple[float, ...]
    coulomb_volts: tuple[float, ...]


@dataclass(frozen=True)
class TrackingModel:
    """Identified quasi-static tracking error ``e = kv v + ka a + kj j``, mm (thesis section 3.6.1)."""

    tracking_kv_s: tuple[float, ...]
    tracking_ka_s2: tuple[float, ...]
    tracking_kj_s3: tuple[float, ...]


@dataclass(frozen=True)
class Machine:
    """Axes and limits of a machine; every tuple has one entry an axis.

    ``axis_map`` holds the rows of the axis map K: axis position = K tool position, both in mm.
    The limits of velocity, acceleration and jerk are infinity where the file gives none.
    ``control_limit_volts`` comes with ``drive`` and ``tracking_error_limit_mm`` with ``tracking``; both are None where
    the file gives no such model. ``tracking_error_reserve_mm`` is the part of the tracking error limit that a plan
    leaves to the servo: for what the quasi-static model leaves out, such as changes of jerk, friction reversals and
    encoder counts (docs/decisions/0014).
    """

    name: str
    yaml_text: str
    axis_names: tuple[str, ...]
    axis_map: tuple[tuple[float, ...], ...]
    feed_limit_mm_s: float
    velocity_limit_mm_s: tuple[float, ...]
    acceleration_limit_mm_s2: tuple[float, ...]
    jerk_limit_mm_s3: tuple[float, ...]
    control_limit_volts: tuple[float, ...] | None = None
    drive: DriveModel | None = None
    tracking_error_limit_mm: tuple[float, ...] | None = None
    tracking_error_reserve_mm: tuple[float, ...] | None = None
    tracking: TrackingModel | None = None

    @property
    def planned_tracking_error_mm(self) -> tuple[float, ...] | None:
        """Tracking error that a plan may use by the model: the limit less the reserve; None without a limit."""
        if self.tracking_error_limit_mm is None or self.tracking_error_reserve_mm is None:
            return self.tracking_error_limit_mm
        rows = zip(self.tracking_error_limit_mm, self.tracking_error_reserve_mm, strict=True)
        return tuple(limit - reserve for limit, reserve in rows)

    @property
    def dimensions(self) -> int:
        """Number of tool coordinates the axes span: 2 (x, y) or 3 (x, y, z)."""
        return len(self.axis_map[0])

    def axis_matrix(self) -> FloatArray:
        """Axis map K, shape (n_axes, dimensions). A gantry repeats a row; the motors of an H-bot mix x and y."""
        return np.array(self.axis_map)

    def tool_matrix(self) -> FloatArray:
        """Tool position = this matrix times axis position, shape (dimensions, n_axes).

        Axes that follow the same coordinate are averaged (least squares).
        """
        return np.asarray(np.linalg.pinv(self.axis_matrix()), dtype=np.float64)


def machine_path(name_or_path: str) -> Path:
    """File of a machine given by path or by its name in ``config/machines``. Raises ConfigError."""
    return find_config("machines", name_or_path)


def load_machine(name_or_path: str) -> Machine:
    """Read and check a machine file.

    Raises:
        ConfigError: no such file, not YAML, a missing, unknown or impossible key; names file, key and axis.
    """
    path = machine_path(name_or_path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    return parse_machine(text, str(path))


def parse_machine(text: str, source: str) -> Machine:
    """Machine from the text of its file; ``source`` names it in errors. Raises ConfigError."""
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{source}: not valid YAML: {error}") from error
    try:
        section = document[_ROOT]["ros__parameters"]["machine"]
    except (TypeError, KeyError) as error:
        raise ConfigError(f"{source}: has no section '{_ROOT}: ros__parameters: machine:'") from error
    if not isinstance(section, Mapping):
        raise ConfigError(f"{source}: section machine is not a mapping of keys to values")
    return _MachineSection(section, source).machine(text)


def _model_keys(model: type[DriveModel] | type[TrackingModel]) -> list[str]:
    return [field.name for field in fields(model)]


class _MachineSection:
    """The section of a machine file while it is being checked."""

    def __init__(self, section: Mapping[str, Any], source: str) -> None:
        self.section = section
        self.source = source

    def machine(self, text: str) -> Machine:
        drive_keys, tracking_keys = _model_keys(DriveModel), _model_keys(TrackingModel)
        drive_limit, tracking_limit = "control_limit_volts", "tracking_error_limit_mm"
        known = {"name", "source", "axis_names", "coordinate", "axis_map", "feed_limit_mm_s", *_LIMITS}
        known |= {drive_limit, *drive_keys, tracking_limit, _RESERVE, *tracking_keys}
        for key in self.section:
            if key not in known:
                raise ConfigError(f"{self.source}: unknown key {key}; known are {', '.join(sorted(known))}")
        names = self._axis_names()
        # A model is given as a whole, with its limit, or not at all.
        has_drive = any(key in self.section for key in (drive_limit, *drive_keys))
        has_tracking = any(key in self.section for key in (tracking_limit, _RESERVE, *tracking_keys))
        machine = Machine(
            name=str(self._value("name")),
            yaml_text=text,
            axis_names=names,
            axis_map=self._axis_map(names),
            feed_limit_mm_s=self._positive("feed_limit_mm_s", self._value("feed_limit_mm_s")),
            **{
                key: self._row(key, names, positive=True) if key in self.section else (math.inf,) * len(names)
                for key in _LIMITS
            },
            control_limit_volts=self._row(drive_limit, names, positive=True) if has_drive else None,
            drive=DriveModel(**{key: self._row(key, names, signed=key == "offset_volts") for key in drive_keys})
            if has_drive
            else None,
            tracking_error_limit_mm=self._row(tracking_limit, names, positive=True) if has_tracking else None,
            tracking_error_reserve_mm=self._row(_RESERVE, names) if _RESERVE in self.section else None,
            tracking=TrackingModel(**{key: self._row(key, names, signed=True) for key in tracking_keys})
            if has_tracking
            else None,
        )
        self._refuse_unbounded(machine)
        for name, left_mm in zip(names, machine.planned_tracking_error_mm or (), strict=False):
            if left_mm <= 0.0:
                raise ConfigError(
                    f"{self.source}: {_RESERVE} of axis {name} leaves nothing of its {tracking_limit} to the plan"
                )
        return machine

    def _refuse_unbounded(self, machine: Machine) -> None:
        """Velocity is bounded by the feed limit at least; acceleration and jerk need a limit or a model."""
        free = (0.0,) * len(machine.axis_names)
        inertia = machine.drive.inertia_volts_s2_mm if machine.drive else free
        ka = machine.tracking.tracking_ka_s2 if machine.tracking else free
        kj = machine.tracking.tracking_kj_s3 if machine.tracking else free
        for i, name in enumerate(machine.axis_names):
            if math.isinf(machine.acceleration_limit_mm_s2[i]) and inertia[i] <= 0.0 and ka[i] <= 0.0:
                raise ConfigError(
                    f"{self.source}: nothing bounds the acceleration of axis {name}: give acceleration_limit_mm_s2, "
                    "or a model with inertia_volts_s2_mm or tracking_ka_s2 above zero"
                )
            if math.isinf(machine.jerk_limit_mm_s3[i]) and kj[i] <= 0.0:
                raise ConfigError(
                    f"{self.source}: nothing bounds the jerk of axis {name}: give jerk_limit_mm_s3, or a tracking "
                    "model with tracking_kj_s3 above zero"
                )

    def _value(self, key: str) -> Any:
        if key not in self.section:
            raise ConfigError(f"{self.source}: {key} is missing; machine files have no defaults")
        return self.section[key]

    def _axis_names(self) -> tuple[str, ...]:
        names = self._value("axis_names")
        if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
            raise ConfigError(f"{self.source}: axis_names must be a list of names, is {names!r}")
        if len(set(names)) != len(names):
            raise ConfigError(f"{self.source}: axis_names has a name twice: {names!r}")
        return tuple(names)

    def _axis_map(self, axis_names: tuple[str, ...]) -> tuple[tuple[float, ...], ...]:
        if ("coordinate" in self.section) == ("axis_map" in self.section):
            raise ConfigError(f"{self.source}: give either coordinate or axis_map, one entry an axis")
        rows = self._coordinate(axis_names) if "coordinate" in self.section else self._matrix(axis_names)
        matrix = np.array(rows)
        missing = [COORDINATES[i] for i in range(matrix.shape[1]) if not np.any(matrix[:, i])]
        if missing:
            raise ConfigError(f"{self.source}: no axis follows coordinate {missing[0]}")
        if np.linalg.matrix_rank(matrix) < matrix.shape[1]:
            raise ConfigError(f"{self.source}: axis_map has dependent rows: the tool can move with every axis at rest")
        return rows

    def _coordinate(self, axis_names: tuple[str, ...]) -> tuple[tuple[float, ...], ...]:
        letters = self._value("coordinate")
        if not isinstance(letters, list) or len(letters) != len(axis_names):
            raise ConfigError(f"{self.source}: coordinate needs one of x, y, z for each of the {len(axis_names)} axes")
        for name, letter in zip(axis_names, letters, strict=True):
            if letter not in COORDINATES:
                raise ConfigError(f"{self.source}: coordinate of axis {name} is {letter!r}, must be x, y or z")
        indices = [COORDINATES.index(letter) for letter in letters]
        return tuple(tuple(float(column == index) for column in range(max(*indices, 1) + 1)) for index in indices)

    def _matrix(self, axis_names: tuple[str, ...]) -> tuple[tuple[float, ...], ...]:
        rows = self._value("axis_map")
        if not isinstance(rows, list) or len(rows) != len(axis_names):
            raise ConfigError(
                f"{self.source}: axis_map needs {len(axis_names)} rows, one for each of {', '.join(axis_names)}"
            )
        for name, row in zip(axis_names, rows, strict=True):
            if not isinstance(row, list) or len(row) not in (2, 3) or len(row) != len(rows[0]):
                raise ConfigError(
                    f"{self.source}: axis_map of axis {name} is {row!r}, must be a list of 2 or 3 factors of x, "
                    "y (, z), as many in every row"
                )
        return tuple(
            tuple(self._number(f"axis_map of axis {name}", value) for value in row)
            for name, row in zip(axis_names, rows, strict=True)
        )

    def _row(
        self, key: str, axis_names: tuple[str, ...], *, positive: bool = False, signed: bool = False
    ) -> tuple[float, ...]:
        values = self._value(key)
        if not isinstance(values, list) or len(values) != len(axis_names):
            raise ConfigError(
                f"{self.source}: {key} needs {len(axis_names)} values, one for each of {', '.join(axis_names)}"
            )
        row = []
        for name, value in zip(axis_names, values, strict=True):
            number = self._number(f"{key} of axis {name}", value)
            if positive and number <= 0.0:
                raise ConfigError(f"{self.source}: {key} of axis {name} is {number:g}, must be above zero")
            if not signed and number < 0.0:
                raise ConfigError(f"{self.source}: {key} of axis {name} is {number:g}, must not be negative")
            row.append(number)
        return tuple(row)

    def _positive(self, key: str, value: Any) -> float:
        number = self._number(key, value)
        if number <= 0.0:
            raise ConfigError(f"{self.source}: {key} is {number:g}, must be above zero")
        return number

    def _number(self, place: str, value: Any) -> float:
        # YAML 1.1 reads 1e-3 without a dot as text; say so instead of failing on a type.
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(f"{self.source}: {place} is {value!r}, must be a number (YAML needs a dot: 1.0e-3)")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ConfigError(f"{self.source}: {place} is {value!r}, must be finite")
        return number
