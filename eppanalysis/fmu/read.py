"""A unit of another tool as the linear part of a loop: its matrices, read by FMPy from the functions of the unit.

A unit for Model Exchange lets its states be set: matrices come from directional derivatives where it provides them,
else from differences, which are exact where it is linear. One that is not linear is linearised at its state of rest.
"""

from __future__ import annotations

import ctypes
import math
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis import units
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError, did_you_mean, require_packages
from eppanalysis.fmu import BASE_UNITS
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.foreign import as_element
from eppanalysis.models.systems.interchange.plant import Plant, looped
from eppanalysis.models.systems.lure import LureSystem

if TYPE_CHECKING:
    import control

#: Step of differences: a power of two, so that it is the same at all states. Formulas of fourth order err by 1e-12.
_STEP = 2.0**-10
#: Where a unit is held against its matrices, in sizes of its states and inputs; what may be rounding of differences.
_SIZES, _ROUNDING = (1e-2, 1.0, 1e2), 1e-9
#: Newton steps to the state of rest.
_MOST_STEPS = 50
#: Types of parameters that are no numbers, and by which functions FMI 2 and 3 set an enumeration.
_NO_NUMBERS = {"String", "Binary", "Clock"}
_SET_AS = {("Real", "Enumeration"): "Integer", ("Float64", "Enumeration"): "Int64"}


def from_fmu(
    path: str | Path,
    elements: Mapping[str | tuple[str, ...], Nonlinearity | control.DescribingFunctionNonlinearity],
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    element_names: Sequence[str] | None = None,
    x0: ArrayLike | None = None,
    v0: Mapping[str, float] | None = None,
    delays: Mapping[str, float] | None = None,
    name: str | None = None,
) -> LureSystem:
    """The loop of a unit (FMU of FMI 2 or 3) and the elements around it. **This runs the code in the unit.**

    A case file is data; a unit is a program. Read units of sources that you trust.

    Parameters
    ----------
    path : str or Path
        Unit for Model Exchange, or one for Co-Simulation that provides directional derivatives.
    elements : mapping of (str, ..., str) or str to Nonlinearity
        By the outputs of the unit that feed an element and the inputs that it drives, as in :func:`from_control`.
        What is an array ``y`` in the unit has the signals ``y[1]``, ``y[2]``, of a matrix ``y[1,1]``.
    parameters : mapping of str to float or array_like, optional
        Parameters of the unit, in its own units; structural ones are set first, as they change sizes.
    element_names, x0, v0, delays, name : optional
        As in :func:`from_control`; state and external inputs [SI] at the start are by default those of the unit.

    Returns
    -------
    LureSystem
        Its signals are the outputs of the unit, in SI units where the unit says what its own are.

    Warns
    -----
    UserWarning
        If the unit is not linear: the loop is that of its linearisation at the state of rest, with all inputs at their
        start values; of a unit for Co-Simulation, at its start.

    Raises
    ------
    EppError
        If FMPy is not installed, the file is no unit that can be run here, the unit fails, or has no state of rest.
    ModelError
        If a signal or parameter is unknown, or a signal is driven twice.
    """
    given = {key: as_element(e) for key, e in elements.items()}
    linear = False
    with suppress(EppError), _opened(Path(path), parameters or {}) as unit:  # which may fail far from its start
        linear = unit.is_linear()
    with _opened(Path(path), parameters or {}) as unit:
        plant = unit.plant(name, linear)
    return looped(plant, given, element_names, x0, v0, delays)


@contextmanager
def _opened(path: Path, parameters: Mapping[str, ArrayLike]) -> Iterator[_Unit]:
    """A unit at its start, in a folder of its own while it is read."""
    require_packages("from_fmu", "fmi", "fmpy")
    import fmpy
    from fmpy.fmi1 import FMICallException

    description = _description(path)
    said: list[str] = []
    with TemporaryDirectory() as folder:
        fmpy.extract(path, folder)
        try:

            def logger(*message: Any) -> None:
                said.append(message[-1].decode(errors="replace"))

            unit = _Unit(path, description, folder, parameters, logger)
            try:
                unit.start()
                yield unit
            finally:
                unit.instance.freeInstance()
        except FMICallException as error:
            why = said[-1] if said else str(error)
            raise EppError(f"{path}: {error.function} fails ({why.rstrip('.')}); expected a unit that runs.") from error


def _description(path: Path) -> Any:
    """The model description of a unit that can be read.

    Raises
    ------
    EppError
        If the file is none, or a unit of another kind or for other platforms.
    """
    import fmpy

    expected = "expected a unit (FMU) of FMI 2 or 3"
    try:
        with zipfile.ZipFile(path) as archive:
            files, text = archive.namelist(), archive.read("modelDescription.xml")
        found = fmpy.read_model_description(path)
    except Exception as error:  # the libraries that read archives and descriptions raise many kinds
        why = str(error).splitlines()[-1].strip(" -.'\"")
        raise EppError(f"{path}: cannot be read ({why}); {expected}.") from error
    if found.fmiVersion == "1.0":
        raise EppError(f"{path}: is a unit of FMI 1; {expected}.")
    kind = found.modelExchange or found.coSimulation
    if kind and re.search(rb"providesDirectionalDerivatives\s*=\s*.(true|1)\b", text):
        kind.providesDirectionalDerivative = True  # FMPy knows it as FMI 2 spells it
    if kind is None or not (found.modelExchange or kind.providesDirectionalDerivative):
        raise EppError(
            f"{path}: is neither for Model Exchange nor gives directional derivatives; expected one of them, as its "
            "states cannot be read otherwise."
        )
    here = fmpy.platform if found.fmiVersion == "2.0" else fmpy.platform_tuple
    if f"binaries/{here}/{kind.modelIdentifier}{fmpy.sharedLibraryExtension}" not in files:
        others = sorted({file.split("/")[1] for file in files if re.match("binaries/.+/", file)})
        raise EppError(f"{path}: has libraries for {', '.join(others) or 'no platform'}; expected one for {here}.")
    return found


class _Signal(NamedTuple):
    """A number of a unit: what it is called, and the variable that it is or is part of."""

    name: str
    variable: Any


class _Unit:
    """An instance of a unit: rates and outputs at points, which are states and inputs; all but states in SI units."""

    def __init__(
        self,
        path: Path,
        description: Any,
        folder: str,
        parameters: Mapping[str, ArrayLike],
        logger: Callable[..., None],
    ) -> None:
        from fmpy.simulation import instantiate_fmu

        self.path, self.description, self.parameters = path, description, parameters
        self.given = self._parameters()
        self.structural = [v for v in self.given if v.causality == "structuralParameter"]
        for variable in self.structural:
            self._require_shape(variable)
        self.of_states = description.modelExchange is not None  # whether they can be set
        self.real = "Real" if description.fmiVersion == "2.0" else "Float64"
        real = [v for v in description.modelVariables if v.type == self.real]
        inputs, outputs = ([v for v in real if v.causality == c] for c in ("input", "output"))
        rates = [unknown.variable for unknown in description.derivatives]
        states = [rate.derivative for rate in rates]
        self.states, self.inputs, self.outputs = map(self._signals, (states, inputs, outputs))
        self.n = len(self.states)
        self.known, self.found = [*states, *inputs], [*rates, *outputs]
        # Factor and offset to SI units; those of states, which are rows of matrices alone, are left as they are.
        self.of_inputs, self.of_outputs = (
            np.array([(1.0, 0.0)] * self.n + [self._unit(s.variable)[1:] for s in of]).reshape(-1, 2)
            for of in (self.inputs, self.outputs)
        )
        self.size = np.array([float(s.variable.nominal or 1.0) for s in (*self.states, *self.inputs)])
        kind = "ModelExchange" if self.of_states else "CoSimulation"
        self.directional = (description.modelExchange or description.coSimulation).providesDirectionalDerivative
        try:
            self.instance = instantiate_fmu(folder, description, kind, logger=logger)
        except Exception as error:  # of many kinds, as its library is loaded
            why = str(error).rstrip(".")
            raise EppError(f"{path}: cannot be instantiated ({why}); expected one that can.") from error

    def _shape(self, variable: Any) -> tuple[int, ...]:
        """Sizes of an array, which structural parameters may give; none of a number."""
        return tuple(
            int(d.start if d.variable is None else np.asarray(self.parameters.get(d.variable.name, d.variable.start)))
            for d in variable.dimensions
        )

    def _signals(self, variables: Sequence[Any]) -> list[_Signal]:
        """Each number of these variables; those of an array ``x`` are ``x[1]`` and so on, its rows one by one."""
        return [
            _Signal(v.name + (f"[{','.join(str(i + 1) for i in place)}]" if place else ""), v)
            for v in variables
            for place in np.ndindex(self._shape(v))
        ]

    def _unit(self, variable: Any) -> tuple[str, float, float]:
        """SI unit of a variable, factor and offset to it; the unit's own where it does not say what that is."""
        name = variable.unit or (variable.declaredType and variable.declaredType.unit) or ""
        base = next((unit.baseUnit for unit in self.description.unitDefinitions if unit.name == name), None)
        if base is None:
            return name, 1.0, 0.0
        exponents = {of_units: float(getattr(base, own)) for own, of_units in BASE_UNITS.items()}
        return units.unit_of(exponents), float(base.factor), float(base.offset)

    def _parameters(self) -> list[Any]:
        """The parameters that are given.

        Raises
        ------
        ModelError
            If one is none of the unit.
        """
        kinds = ("parameter", "structuralParameter")
        variables = [v for v in self.description.modelVariables if v.causality in kinds and v.type not in _NO_NUMBERS]
        known = {v.name: v for v in variables}
        for name in self.parameters:
            if name not in known:
                expected = f"a parameter: {did_you_mean(name, list(known))}"
                raise ModelError(self.path.name, name, expected, field="parameters")
        return [known[name] for name in self.parameters]

    def _require_shape(self, variable: Any) -> None:
        found, shape = np.shape(self.parameters[variable.name]), self._shape(variable)
        if found != shape:
            what = f"{self.path.name}: parameter {variable.name} has the shape {found}"
            raise ModelError(what, expected=f"{shape}" if shape else "a number")

    def start(self) -> None:
        """Initialise the unit with its parameters."""
        unit = self.instance
        if self.structural:
            unit.enterConfigurationMode()
            self._set_parameters(self.structural)
            unit.exitConfigurationMode()
        if self.real == "Real":
            unit.setupExperiment()
        self._set_parameters([v for v in self.given if v not in self.structural])
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        if self.of_states:
            self._events()

    def _set_parameters(self, variables: Sequence[Any]) -> None:
        for variable in variables:
            self._require_shape(variable)
            kind = _SET_AS.get((self.real, variable.type), variable.type)
            numbers = np.ravel(np.asarray(self.parameters[variable.name], float)).tolist()
            whole = not kind.startswith(("Real", "Float"))
            getattr(self.instance, f"set{kind}")(
                [variable.valueReference], [*map(round, numbers)] if whole else numbers
            )

    def _events(self) -> None:
        """Through the events at a point, to where it may be evaluated."""
        update = self.instance.newDiscreteStates if self.real == "Real" else self.instance.updateDiscreteStates
        while update()[0]:
            pass
        self.instance.enterContinuousTimeMode()

    def _get(self, variables: Sequence[Any], to_si: Array) -> Array:
        count = {} if self.real == "Real" else {"nValues": len(to_si)}
        references = [v.valueReference for v in variables]
        values = getattr(self.instance, f"get{self.real}")(references, **count) if references else []
        return to_si[:, 0] * np.array(values, float) + to_si[:, 1]

    def at_start(self) -> Array:
        """The point at the start, shape (n + m,)."""
        return self._get(self.known, self.of_inputs)

    def evaluate(self, point: Array) -> Array:
        """Rates of the states and outputs, shape (n + k,)."""
        if self.of_states:
            values, n = ((point - self.of_inputs[:, 1]) / self.of_inputs[:, 0]).tolist(), self.n
            if n:
                self.instance.setContinuousStates((ctypes.c_double * n)(*values[:n]), n)
            # Inputs that jump may be set at events alone, and what a point switches is switched there.
            self.instance.enterEventMode()
            inputs = [v.valueReference for v in self.known if v.causality == "input"]
            if inputs:
                getattr(self.instance, f"set{self.real}")(inputs, values[n:])
            self._events()
        return self._get(self.found, self.of_outputs)

    def _directional(self) -> Array:
        """Derivatives at the point, in the units of the unit, a column for each number of a state or input."""
        count = {} if self.real == "Real" else {"nSensitivity": len(self.of_outputs)}
        found = [v.valueReference for v in self.found]
        columns = []
        for v in self.known:
            # Of itself a variable has the derivative 1, also where a unit knows those of its equations alone.
            itself = np.repeat([v is other for other in self.found], [math.prod(self._shape(o)) for o in self.found])
            for seed in np.eye(math.prod(self._shape(v))):
                column = np.array(
                    self.instance.getDirectionalDerivative(found, [v.valueReference], seed.tolist(), **count)
                )
                column[itself] = seed if itself.any() else 0.0
                columns.append(column)
        return np.array(columns).T.reshape(len(self.of_outputs), len(self.of_inputs))

    def jacobian(self, point: Array) -> Array:
        """Derivatives of what :meth:`evaluate` gives, shape (n + k, n + m)."""
        if self.directional:
            self.evaluate(point)
            return self.of_outputs[:, :1] * self._directional() / self.of_inputs[:, 0]
        J = np.zeros((len(self.of_outputs), len(point)))
        for j, h in enumerate(_STEP * self.size):
            by = {k: self.evaluate(point + k * h * np.eye(len(point))[j]) for k in (-2, -1, 1, 2)}
            J[:, j] = (8.0 * (by[1] - by[-1]) - (by[2] - by[-2])) / (12.0 * h)
            # What may be rounding of the values is none.
            rounding = 8.0 * np.finfo(float).eps * np.max(np.abs(list(by.values())), axis=0, initial=0.0) / h
            J[np.abs(J[:, j]) <= rounding, j] = 0.0
        return J

    def is_linear(self) -> bool:
        """Whether the unit is where its matrices at the start say, near and far; never where states cannot be set."""
        if not self.of_states:
            return False
        start, random = self.at_start(), np.random.default_rng(0)
        there, J = self.evaluate(start), self.jacobian(start)
        for size in np.repeat(_SIZES, 4):
            way = size * self.size * random.uniform(-1.0, 1.0, len(start))
            terms = np.abs(there) + np.abs(J) @ np.abs(way)
            if not np.all(np.abs(self.evaluate(start + way) - there - J @ way) <= _ROUNDING * terms):
                return False
        return True

    def at_rest(self, start: Array) -> Array:
        """The point at rest by Newton's method from the start, the inputs held.

        Raises
        ------
        EppError
            If there is none.
        """
        n, point = self.n, start.copy()
        for _ in range(_MOST_STEPS):
            rate, A = self.evaluate(point)[:n], self.jacobian(point)[:n, :n]
            if not np.all(np.isfinite([*rate, *A.ravel()])):
                break
            step = np.linalg.lstsq(A, -rate, rcond=None)[0]
            point[:n] += step
            sizes = np.maximum(self.size, np.abs(point))[:n]
            if np.all(np.abs(step) <= 1e-12 * sizes):
                point[:n][np.abs(point[:n]) <= 1e-12 * self.size[:n]] = 0.0  # what it is known to
                if np.all(np.abs(self.evaluate(point)[:n]) <= _ROUNDING * np.abs(A) @ sizes):
                    return point
                break
        raise EppError(
            f"{self.path}: is not linear and has no state of rest near its start; expected one, under the start values "
            "of its inputs."
        )

    def plant(self, name: str | None, linear: bool) -> Plant:
        """The unit as a linear system with names, with a warning where it is not one."""
        start, n = self.at_start(), self.n
        around = np.zeros(len(start)) if linear else self.at_rest(start) if self.of_states else start
        if not linear:
            where = ", ".join(f"{v.name} = {x:.6g}" for v, x in zip(self.states, around, strict=False))
            what = "is not linear; it is linearised at rest" if self.of_states else "is linearised at its start"
            warnings.warn(f"{self.path.name} {what} ({where}).", stacklevel=2)
        J = self.jacobian(around)
        constant = self.evaluate(around) - J @ around
        inputs, outputs, states = (tuple(v.name for v in of) for of in (self.inputs, self.outputs, self.states))
        return Plant(
            *(J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]),
            inputs=inputs,
            outputs=outputs,
            states=states,
            time_step=None,
            name=name or self.description.modelName,
            constant_state=constant[:n],
            constant_output=constant[n:],
            units=tuple(self._unit(s.variable)[0] for s in self.outputs),
            levels=start[n:],
            x0=start[:n],
        )
