"""Named parameters and expressions: values, units, exact derivatives, and what is refused in which words."""

from __future__ import annotations

import math
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from eppanalysis.cases.files import RawCase
from eppanalysis.cases.values.expressions import Value, is_expression, parse
from eppanalysis.cases.values.parameters import Named, read, resolve
from eppanalysis.cases.values.quantities import Quantity
from eppanalysis.errors import CaseError
from eppanalysis.units import QuantityError, dimensions, unit_of

SERVO = {
    "Kp": {"value": "40 V/rad", "tolerance": "10 %", "mark": "measured"},
    "Ti": "0.4 s",
    "J1": "0.05 kg*m^2",
    "J2": "0.03 kg*m^2",
    "k": "800 N*m/rad",
    "f": "2 Hz",
    "angle": "30 deg",
    "area": "4 m^2",
    "ratio": 50.0,
    "zero": "0 s",
}


def of(**tables: Any) -> dict[str, Named]:
    raw = RawCase("servo", "servo.toml", Path(), {"parameters": tables})
    return resolve(tables, "parameters", raw)


def found(text: str) -> Value:
    return of(**SERVO, it=text)["it"].value


def refused(**tables: Any) -> str:
    with pytest.raises(CaseError) as caught:
        of(**tables)
    sentence = str(caught.value)
    assert sentence.startswith("servo.toml: parameters.") and sentence.endswith((".", "?")) and "\n" not in sentence
    return sentence


def test_values_and_units() -> None:
    for text, number, unit in [
        ("Kp*Ti", 16.0, "V*s/rad"),
        ("Kp/Ti", 100.0, "V/rad/s"),
        ("Kp", 40.0, "V/rad"),
        ("1/(J1 + J2)", 12.5, "1/kg/m^2"),
        ("2*pi*f", 4 * math.pi, "Hz"),
        ("sqrt(k/J1)", math.sqrt(16000.0), "Hz"),
        ("k/J1 + 1/Ti^2", 16006.25, "1/s^2/rad"),
        ("1/Ti^2 + k/J1", 16006.25, "1/s^2/rad"),
        ("sqrt(area)*3", 6.0, "m"),
        ("sqrt(J1)*sqrt(J2)", math.sqrt(0.0015), "kg*m^2"),
        ("area^(3/2)", 8.0, "m^3"),
        ("area ** -1", 0.25, "1/m^2"),
        ("-ratio^2", -2500.0, ""),
        ("2^3^2", 512.0, ""),
        ("2^-1", 0.5, ""),
        ("ratio·2 − ratio²", -2400.0, ""),
        ("1e3*2.5e-1 + .5", 250.5, ""),
        ("sin(angle) + cos(2*angle)", 1.0, ""),
        ("tan(pi/4)", 1.0, ""),
        ("atan(1)", math.pi / 4, "rad"),
        ("exp(log(ratio)/2)", math.sqrt(50.0), ""),
        ("max(0, J1, J2)", 0.05, "kg*m^2"),
        ("min(J1, J2)", 0.03, "kg*m^2"),
        ("abs(J2 - J1)", 0.02, "kg*m^2"),
        ("0 + Ti", 0.4, "s"),
        ("+Ti", 0.4, "s"),
        ("11/Ti", 27.5, "Hz"),
    ]:
        value = found(text)
        assert value.number == pytest.approx(number, rel=1e-14)
        assert value.unit == dimensions(unit)


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("5 mm", False),
        ("5mm", False),
        ("3", False),
        ("-2e3", False),
        ("5 1/s", False),
        (3.0, False),
        (True, False),
        ("m", True),
        ("Kp", True),
        ("2*Kp", True),
        ("11/J", True),
        ("1/s", True),
        ("-Kp", True),
        ("5 furlong_", True),
    ],
)
def test_what_begins_with_a_number_and_is_a_quantity_is_no_expression(text: object, answer: bool) -> None:
    assert is_expression(text) is answer


X, Y = 1.3, 0.7
SLOPES = [
    ("x*y", Y, X),
    ("x/y", 1 / Y, -X / Y**2),
    ("x - 3*y", 1.0, -3.0),
    ("-(x + y)*x", -2 * X - Y, -X),
    ("x^y", Y * X ** (Y - 1), X**Y * math.log(X)),
    ("x^3", 3 * X**2, 0.0),
    ("sqrt(x*y)", Y / 2 / math.sqrt(X * Y), X / 2 / math.sqrt(X * Y)),
    ("exp(x*y)", Y * math.exp(X * Y), X * math.exp(X * Y)),
    ("log(x/y)", 1 / X, -1 / Y),
    ("sin(x)*cos(y)", math.cos(X) * math.cos(Y), -math.sin(X) * math.sin(Y)),
    ("tan(x)", 1 / math.cos(X) ** 2, 0.0),
    ("atan(x/y)", Y / (X**2 + Y**2), -X / (X**2 + Y**2)),
    ("abs(y - x)", 1.0, -1.0),
    ("min(x, y)", 0.0, 1.0),
    ("max(x, y, 1)", 1.0, 0.0),
    ("max(x, x)", 1.0, 0.0),
]


@pytest.mark.parametrize(("text", "by_x", "by_y"), SLOPES)
def test_derivatives_are_those_of_the_closed_forms(text: str, by_x: float, by_y: float) -> None:
    gradient = parse(text).value({"x": Value(X, {}, {"x": 1.0}), "y": Value(Y, {}, {"y": 1.0})}).gradient
    assert gradient.get("x", 0.0) == pytest.approx(by_x, rel=1e-14, abs=1e-15)
    assert gradient.get("y", 0.0) == pytest.approx(by_y, rel=1e-14, abs=1e-15)


@pytest.mark.parametrize("text", ["abs(x)", "min(x, 2*x)", "sqrt(x)", "x^0.5", "max(0, x)"])
def test_where_there_is_no_derivative_it_is_nan(text: str) -> None:
    found = parse(text).value({"x": Value(0.0, {}, {"x": 1.0})})
    assert found.number == 0.0 and math.isnan(found.gradient["x"])


def test_zero_to_a_power_that_moves() -> None:
    x = Value(0.0, {}, {"x": 1.0})
    assert dict(parse("x^n").value({"x": x, "n": Value(2.0, {}, {"n": 1.0})}).gradient) == {"x": 0.0, "n": 0.0}
    assert parse("x^0").value({"x": x}).gradient == {"x": 0.0}


_LEAVES = st.sampled_from(["x", "y", "pi"]) | st.floats(0.1, 9.0).map(repr)
_TREES = st.recursive(
    _LEAVES,
    lambda inner: (
        st.tuples(st.sampled_from("+-*/"), inner, inner)
        | st.tuples(st.sampled_from(["sqrt", "exp", "log", "sin", "cos", "tan", "atan", "-"]), inner)
        | st.tuples(st.sampled_from("^"), inner, st.sampled_from(["2", "3", "-1"]))
    ),
    max_leaves=8,
)
_BY_NUMPY: dict[str, Any] = {
    "+": np.add,
    "-": lambda *a: np.subtract(*a) if len(a) == 2 else np.negative(*a),
    "*": np.multiply,
    "/": np.divide,
    "^": np.power,
    "atan": np.arctan,
}


def _written(tree: Any) -> str:
    if isinstance(tree, str):
        return tree
    name, *inner = tree
    texts = [_written(part) for part in inner]
    if len(texts) == 1:
        return f"{name}({texts[0]})"
    return f"({texts[0]}) {name} ({texts[1]})"


def _by_numpy(tree: Any, names: dict[str, complex]) -> complex:
    if isinstance(tree, str):
        return names[tree] if tree in names else np.complex128(float(tree))
    name, *inner = tree
    function = _BY_NUMPY.get(name) or getattr(np, name)
    return function(*(_by_numpy(part, names) for part in inner))


@given(_TREES, st.floats(0.2, 5.0), st.floats(0.2, 5.0))
def test_random_expressions_agree_with_numpy_and_derivatives_with_complex_steps(tree: Any, x: float, y: float) -> None:
    text = _written(tree)
    assume(len(text) <= 200)
    values = {"x": Value(x, {}, {"x": 1.0}), "y": Value(y, {}, {"y": 1.0})}
    step = 1e-200
    with np.errstate(all="ignore"):
        names = {"x": np.complex128(x), "y": np.complex128(y), "pi": np.complex128(math.pi)}
        wanted = _by_numpy(tree, names)
        slopes = {name: _by_numpy(tree, {**names, name: names[name] + 1j * step}).imag / step for name in values}
    try:
        found = parse(text).value(values)
    except QuantityError:  # out of the real numbers, or of their range
        assert not np.isfinite(wanted) or abs(wanted.imag) > 0 or _leaves_the_reals(tree, x, y)
        return
    assume(_is_tame(tree, names))
    assert found.number == pytest.approx(wanted.real, rel=1e-9, abs=1e-9)
    for name, slope in slopes.items():
        assert found.gradient.get(name, 0.0) == pytest.approx(slope, rel=1e-7, abs=1e-7)


def _parts(tree: Any) -> list[Any]:
    return [tree] if isinstance(tree, str) else [tree, *(p for part in tree[1:] for p in _parts(part))]


def _leaves_the_reals(tree: Any, x: float, y: float) -> bool:
    """Whether a root or logarithm of what is negative, a division by zero or an overflow is inside."""
    names = {"x": np.float64(x), "y": np.float64(y), "pi": np.float64(math.pi)}
    with np.errstate(all="ignore"):
        return any(not np.isfinite(_by_real_numpy(part, names)) for part in _parts(tree))


def _by_real_numpy(tree: Any, names: dict[str, Any]) -> Any:
    if isinstance(tree, str):
        return names[tree] if tree in names else np.float64(tree)
    function = _BY_NUMPY.get(tree[0]) or getattr(np, tree[0])
    return function(*(_by_real_numpy(part, names) for part in tree[1:]))


def _is_tame(tree: Any, names: dict[str, complex]) -> bool:
    """Whether rounding is not magnified beyond the tolerance: no part is huge or next to zero."""
    with np.errstate(all="ignore"):
        return all(1e-3 < abs(_by_numpy(part, names)) < 1e3 for part in _parts(tree))


def test_parameters_are_found_in_any_order_with_marks_tolerances_and_derivatives_by_quantities() -> None:
    forward = {"a": "2*b", "b": {"value": "c + Ti", "mark": "paper", "note": "as built"}, "c": "Ti*ratio", **SERVO}
    named, other = of(**forward), of(**dict(reversed(forward.items())))
    assert list(named) == list(forward) and named == {name: other[name] for name in named}
    assert named["a"].value == Value(40.8, {"second": 1}, {"Ti": 102.0, "ratio": 0.8})
    assert str(named["a"].parameter) == "40.8 s" and named["a"].parameter.mark == "derived"
    assert (named["b"].parameter.mark, named["b"].parameter.note) == ("paper", "as built")
    assert named["b"].parameter.tolerance is None
    assert (named["Kp"].parameter.tolerance, named["Kp"].parameter.mark) == (4.0, "measured")
    assert named["Kp"].value.gradient == {"Kp": 1.0}


def test_what_is_computed_is_no_count_of_turns() -> None:
    named = of(**SERVO, omega="sqrt(k/J1)", twice="f")
    assert named["omega"].parameter.unit == "1/s" and named["twice"].parameter.unit == "Hz"


def test_names_of_units_of_results_read_back() -> None:
    for text in ("Kp*Ti", "Kp/Ti^2", "1/(J1*Ti)", "k*angle", "area^2"):
        assert dimensions(of(**SERVO, it=text)["it"].parameter.unit) == found(text).unit
        assert dimensions(unit_of(found(text).unit)) == found(text).unit


def test_expressions_can_be_sent_to_another_process() -> None:
    expression = pickle.loads(pickle.dumps(parse("2*x")))
    assert expression == parse("2*x") and expression.value({"x": Value(3.0)}).number == 6.0


def test_refusals_say_what_is_wrong() -> None:
    for text, words in [
        ("Kp + Ti", "two of one unit: Kp + Ti adds V/rad to s."),
        ("Kp - Ti*2", "two of one unit: Kp - Ti*2 takes s from V/rad."),
        ("1 + Ti", "two of one unit: 1 + Ti adds a plain number to s."),
        ("zero + Kp", "two of one unit: zero + Kp adds s to V/rad."),
        ("max(J1, Ti)", "two of one unit: max(J1, Ti) compares kg*m^2 with s."),
        ("max(J1, J2, Ti)", "all of one unit: max(J1, J2, Ti) compares kg*m^2 with s."),
        ("exp(Ti)", "a plain number or an angle: exp(Ti) has s."),
        ("sin(2*Ti)", "a plain number or an angle: sin(2*Ti) has s."),
        ("sqrt(Ti)", "whole powers of units, at most 9: sqrt(Ti) is in s^0.5."),
        ("area^5", "whole powers of units, at most 9: area^5 is in m^10."),
        ("area^0.123", "a simple fraction as exponent of what has a unit: 0.123 is 0.123."),
        ("area^ratio", "a number, no parameter, as exponent of what has a unit: area^ratio."),
        ("2^Ti", "a plain number as exponent: that of 2^Ti is in s."),
        ("Ti/(J1 - J1)", "a divisor that is not zero: J1 - J1 is 0."),
        ("0^-1", "a divisor that is not zero: 0^-1 divides by 0."),
        ("(-8)^(1/3)", "a whole power of a negative number: -8 is -8."),
        ("sqrt(J2 - J1)", "an argument that is not negative: sqrt(J2 - J1) has -0.02."),
        ("log(0*ratio)", "an argument that is positive: log(0*ratio) has 0."),
        ("exp(1000)", "a finite number: exp(1000) is beyond all range."),
        ("1e300*1e300", "a finite number: 1e300*1e300 is beyond all range."),
        ("1/1e-320", "a finite number: 1/1e-320 is beyond all range."),
        ("9**9**9**9", "a finite number: 9^9^9 is beyond all range."),
        ("kp*Ti", "a known parameter in place of 'kp': did you mean 'Kp'?"),
        ("Kp*ration", "a known parameter in place of 'ration': did you mean 'ratio'?"),
        ("Kp*wholly_else", "a known parameter in place of 'wholly_else': one of Kp, Ti, J1, J2,"),
        ("sqr(Kp)", "a known function in place of 'sqr': did you mean 'sqrt'?"),
        ("Kp(2)", "a known function in place of 'Kp'"),
        ("sqrt + 1", "an argument of sqrt, as in 'sqrt(x)'."),
        ("sqrt(1, 2)", "one argument of sqrt."),
        ("min(J1)", "two or more arguments of min."),
        ("5 mmm", "a known unit in place of 'mmm'."),
        ("Kp/(1 rad)", "give '1 rad' a name in [parameters], and write that here."),
        ("Kp - .5e-3V/rad", "give '.5e-3 V' a name in [parameters], and write that here."),
        ("5 mm + 3", "give '5 mm' a name in [parameters], and write that here."),
        ("Kp*2.7 mNm", "give '2.7 mN*m' a name in [parameters], and write that here."),
        ("(3 J1)*2", "a sign between 3 and J1, as in '3*J1'."),
        ("", "a quantity such as '5 mm', or an expression"),
        ("-" * 150 + "1", "at most 100 operations inside one another"),
        ("1+" * 200 + "1", "at most 200 characters long"),
    ]:
        assert words in refused(**SERVO, it=text)


def test_only_arithmetic_is_read_and_nothing_is_executed() -> None:
    for text in [
        "__import__('os')",
        "().__class__",
        "Kp.real",
        "[1]",
        "{}",
        "lambda: 0",
        "Kp if Kp else Kp",
        "'x'*10**9",
        "Kp or Ti",
        "not Kp",
        "Kp in Ti",
        "Kp < Ti",
        "Kp == Ti",
        "Kp // Ti",
        "Kp % Ti",
        "Kp @ Ti",
        "~Kp",
        "(Kp, Ti)",
        "()",
        "min(*Kp, 2)",
        "sqrt(x=1)",
        "(y := 3)",
        "f'{Kp}'",
        "True",
        "None",
        "1j",
        "0x10",
        "1or 2",
        "Kp Ti",
        "Kp*(0.4 s)",
        "Kp*^2",
        "Kp\n+Ti",
        "Kp;Ti",
        "ℯ",
        "(" * 150 + "1" + ")" * 40,
        "(" * 99 + "1" + ")" * 99,
        "\x00",
        "#",
    ]:
        begun = time.perf_counter()
        if text == "(" * 99 + "1" + ")" * 99:
            assert found(text).number == 1.0
        else:
            said = refused(**SERVO, it=text)
            assert "expression" in said or "a known unit in place of 'j'" in said
        assert time.perf_counter() - begun < 5.0


@given(st.text(alphabet="xy1.+-*/^(), esqrtminp", max_size=30))
def test_any_text_is_a_finite_number_or_refused(text: str) -> None:
    try:
        assert math.isfinite(parse(text).value({"x": Value(2.0), "y": Value(3.0)}).number)
    except QuantityError as error:
        assert error.expected


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"Kp": "Ti*2", "Ti": "Kp/3"}, "parameters.Kp is 'Ti*2'; expected an expression that does not lead back to "
         "itself: Kp uses Ti, which uses Kp."),
        ({"a": 1, "c": "d", "b": "c", "d": "b + a"}, "itself: c uses d, which uses b, which uses c."),
        ({"Kp": "Kp"}, "itself: Kp uses Kp."),
        ({f"p{i}": f"p{(i + 1) % 300}" for i in range(300)}, "which uses ..., which uses p0."),
        ({"sqrt": 1.0}, "parameters.sqrt is 1.0; expected a name that is no function"),
        ({"pi": "3"}, "no function or constant of expressions"),
        ({"lambda": 1.0}, "no word of Python"),
        ({"a.b": 1.0}, "a plain name of letters"),
        ({"Kp": True}, "parameters.Kp is true; expected a number with or without a unit."),
        ({"Kp": [1.0]}, "parameters.Kp is [1.0]; expected a number with or without a unit."),
        ({"Kp": {"value": "1 m", "mark": "guessed"}}, "a mark that is one of"),
        ({"Kp": {"mark": "paper"}}, "a table with a value"),
        ({"T": "1 s", "Kp": {"value": "2*T", "tolerance": "1 %"}}, "no tolerance beside an expression"),
        ({"T": "1 s", "Kp": {"value": "2*T", "mark": "guessed"}}, "a mark that is one of"),
        ({"T": "1 s", "Kp": {"value": "2*T", "unit": "s"}}, "without 'unit'"),
        ({"Kp": "Ti"}, "parameters.Kp is 'Ti'; expected a known parameter in place of 'Ti': there is none."),
    ],
)  # fmt: skip
def test_refused_parameters(tables: dict[str, Any], words: str) -> None:
    assert words in refused(**tables)


def test_a_chain_of_a_thousand_parameters() -> None:
    chain = {f"p{i}": f"p{i + 1} + 1" for i in range(1000)}
    assert of(**chain, p1000="5")["p0"].value == Value(1005.0, {}, {"p1000": 1.0})


def _field(given: Any, unit: str, **limits: float) -> Named:
    raw = RawCase("servo", "servo.toml", Path(), {"blocks": {"hold": {"time": given}}})
    return read(given, "blocks.hold.time", raw, of(**SERVO), Quantity(unit, **limits))


def test_a_field_takes_a_quantity_or_an_expression_of_its_unit_but_for_radians() -> None:
    assert _field("3 ms", "s") == Named(Quantity("s").read("3 ms"), Value(0.003, {"second": 1}))
    assert _field("1/(10*f)", "s").parameter.value == pytest.approx(0.05)
    assert _field("2*pi*f", "rad/s").parameter.unit == "rad/s"
    assert _field("k*angle", "N*m").value.gradient == pytest.approx({"k": math.pi / 6, "angle": 800.0})
    assert _field("ratio*2", "s").parameter.value == 100.0


@pytest.mark.parametrize(
    ("given", "unit", "limits", "words"),
    [
        ("2*Kp", "s", {}, "blocks.hold.time is '2*Kp'; expected a time such as '1 ms': 2*Kp is in V/rad."),
        ("f", "rad/s", {}, "(Hz counts turns; write turn/s): f is in Hz."),
        ("-2*Ti", "s", {"above": 0.0}, "expected a positive number: -2*Ti is -0.8 s."),
        ("5 mm", "s", {}, "blocks.hold.time is '5 mm'; expected a time such as '1 ms'."),
    ],
)
def test_a_field_refuses_what_it_cannot_be(given: Any, unit: str, limits: dict[str, float], words: str) -> None:
    with pytest.raises(CaseError) as caught:
        _field(given, unit, **limits)
    assert words in str(caught.value)
