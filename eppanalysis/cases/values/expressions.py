"""Arithmetic expressions of a case file's parameters: "Kp*Ti", "1/(J1 + J2)", "sqrt(k/J)".

Python's own parser reads an expression and a walk over its tree computes it: nothing is executed. What is computed is
a number in SI units, its unit, and its exact derivatives (forward mode) by the parameters that are given as quantities.

Units follow one rule: where two meet in a sum, min or max they are equal but for radians, which people leave out in
quotients ("N*m*s"); functions take plain numbers or angles; 0 has any unit. "1/s" is taken for an angular velocity.
"""

from __future__ import annotations

import ast
import difflib
import math
import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache

from eppanalysis.errors import UnknownName
from eppanalysis.units import SPELLINGS, NoQuotient, QuantityError, UnknownUnit, dimensions, meant, parse_any, unit_of

LONGEST = 200
DEEPEST = 100
LARGEST_POWER = 9
_TOKENS = re.compile(
    r"(?:[ \t]*(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?(?![\w.])|[A-Za-z_]\w*|\*\*|[-+*/(),]))*[ \t]*", re.ASCII
)
#: A number with a name right behind it, as no arithmetic has them.
_QUANTITY = re.compile(r"(?<![\w.])((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?)[ \t]*([^\W\d_]\w*|[%°])")
_WANTED = "a quantity such as '5 mm', or an expression of numbers, parameters, + - * / ^ and functions such as 'Kp*Ti'"

#: Functions of plain numbers, and their slopes from x and f(x).
_PLAIN: dict[str, tuple[Callable[[float], float], Callable[[float, float], float]]] = {
    "exp": (math.exp, lambda x, y: y),
    "log": (math.log, lambda x, y: 1.0 / x),
    "sin": (math.sin, lambda x, y: math.cos(x)),
    "cos": (math.cos, lambda x, y: -math.sin(x)),
    "tan": (math.tan, lambda x, y: 1.0 + y * y),
    "atan": (math.atan, lambda x, y: 1.0 / (1.0 + x * x)),
}
FUNCTIONS = ("sqrt", *_PLAIN, "abs", "min", "max")
_OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)

Unit = Mapping[str, int | Fraction]


@dataclass(frozen=True)
class Value:
    """What an expression comes to."""

    number: float  # in SI units
    unit: Unit = field(default_factory=dict)  # exponents of the base units, angles among them
    #: Derivative by each parameter that it depends on, in SI units; nan where there is none (abs at 0, equal arguments
    #: of min).
    gradient: Mapping[str, float] = field(default_factory=dict)


def _chain(number: float, unit: Unit, *terms: tuple[float, Value]) -> Value:
    """A value that depends on others with these slopes."""
    gradient: dict[str, float] = {}
    for slope, value in terms:
        for name, inner in value.gradient.items():
            gradient[name] = gradient.get(name, 0.0) + slope * inner
    finite = {name: slope if math.isfinite(slope) else math.nan for name, slope in gradient.items()}
    return Value(number, {name: power for name, power in unit.items() if power}, finite)


def times(first: Unit, second: Unit, power: int | Fraction = 1) -> Unit:
    """Exponents of a unit times a power of another one."""
    if not second or (not first and power == 1):
        return first or second
    return {name: first.get(name, 0) + power * second.get(name, 0) for name in {**first, **second}}


def alike(first: Unit, second: Unit) -> bool:
    """Whether two units are equal but for radians.

    Examples
    --------
    >>> from eppanalysis.units import dimensions
    >>> torque = dimensions("N*m")
    >>> alike(dimensions("N*m/rad"), torque), alike(torque, dimensions("N"))
    (True, False)
    """
    return not any(power for name, power in times(first, second, -1).items() if name != "radian")


def same_unit(first: str, second: str) -> bool:
    """Whether a quantity may replace another: radians may be left out, turns per second are no rad/s.

    Examples
    --------
    >>> same_unit("V/rad", "V"), same_unit("rad/s", "1/s")
    (True, True)
    >>> same_unit("rad/s", "Hz"), same_unit("rad", "m")
    (False, False)
    """
    turns = "Hz" in (first, second)
    return first == second or (not turns and alike(dimensions(first), dimensions(second)))


def _radians(unit: Unit) -> tuple[float, float]:
    """Order of units that are equal but for radians."""
    power = float(unit.get("radian", 0))
    return abs(power), power


def name_of_unit(unit: Unit) -> str:
    """Text of a unit; what is computed is no count of turns, and `unit_of` gives no Hz."""
    return unit_of({name: float(power) for name, power in unit.items()})


def _shown(unit: Unit) -> str:
    return name_of_unit(unit) or "a plain number"


@dataclass(frozen=True)
class Expression:
    """An arithmetic expression of parameters."""

    text: str
    names: tuple[str, ...]  # parameters that it uses, in their order
    _tree: ast.expr = field(repr=False, compare=False)

    def value(self, values: Mapping[str, Value]) -> Value:
        """What it comes to.

        Raises
        ------
        QuantityError
            If a name is not known, units do not go together, or there is no finite number.

        Examples
        --------
        >>> Kp, Ti = Value(40.0, {}, {"Kp": 1.0}), Value(0.4, {"second": 1}, {"Ti": 1.0})
        >>> found = parse("Kp*Ti").value({"Kp": Kp, "Ti": Ti})
        >>> found.number, dict(found.gradient)
        (16.0, {'Kp': 0.4, 'Ti': 40.0})
        """
        for name in self.names:
            if name not in values:
                raise unknown_name(name, values)
        found = self._compute(self._tree, values)
        # Radians are plain numbers, of which a broken power says nothing.
        unit = {name: power for name, power in found.unit.items() if name != "radian" or power.denominator == 1}
        if any(power.denominator != 1 or abs(float(power)) > LARGEST_POWER for power in unit.values()):
            raise QuantityError(f"whole powers of units, at most {LARGEST_POWER}: {self.text} is in {_shown(unit)}")
        return replace(found, unit={name: int(power) for name, power in unit.items()})

    def _at(self, node: ast.expr) -> str:
        """What is there in the text."""
        return self.text.replace("^", "**")[node.col_offset : node.end_col_offset].replace("**", "^")

    def _compute(self, node: ast.expr, values: Mapping[str, Value]) -> Value:
        try:
            found = self._of_node(node, values)
        except OverflowError:
            found = Value(math.inf)
        if not math.isfinite(found.number):
            raise QuantityError(f"a finite number: {self._at(node)} is beyond all range")
        return found

    def _of_node(self, node: ast.expr, values: Mapping[str, Value]) -> Value:
        if isinstance(node, ast.Constant):
            return Value(float(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name):
            return Value(math.pi) if node.id == "pi" else values[node.id]
        if isinstance(node, ast.UnaryOp):
            inner = self._compute(node.operand, values)
            sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
            return _chain(sign * inner.number, inner.unit, (sign, inner))
        if isinstance(node, ast.BinOp):
            return self._operate(node, self._compute(node.left, values), self._compute(node.right, values))
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        return self._apply(node.func.id, node, [self._compute(argument, values) for argument in node.args])

    def _operate(self, node: ast.BinOp, left: Value, right: Value) -> Value:
        a, b = left.number, right.number
        if isinstance(node.op, ast.Add):
            return _chain(a + b, self._common(node, "adds {} to {}", left, right), (1.0, left), (1.0, right))
        if isinstance(node.op, ast.Sub):
            unit = self._common(node, "takes {1} from {0}", left, right)
            return _chain(a - b, unit, (1.0, left), (-1.0, right))
        if isinstance(node.op, ast.Mult):
            return _chain(a * b, times(left.unit, right.unit), (b, left), (a, right))
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right)
        if b == 0:
            raise QuantityError(f"a divisor that is not zero: {self._at(node.right)} is 0")
        return _chain(a / b, times(left.unit, right.unit, -1), (1.0 / b, left), (-(a / b) / b, right))

    def _common(self, node: ast.expr, verb: str, *values: Value) -> Unit:
        """The unit of values that must have one, with its radians where some leave them out."""
        units = [value.unit for value in values if value.number or value.unit or value.gradient]
        for other in units[1:]:
            if not alike(units[0], other):
                said = verb.format(_shown(units[0]), _shown(other))
                raise QuantityError(f"{'two' if len(values) == 2 else 'all'} of one unit: {self._at(node)} {said}")
        return max(units, key=_radians, default={})

    def _power(self, node: ast.BinOp, base: Value, exponent: Value) -> Value:
        a, b = base.number, exponent.number
        plain = alike(base.unit, {})
        if not alike(exponent.unit, {}):
            raise QuantityError(f"a plain number as exponent: that of {self._at(node)} is in {_shown(exponent.unit)}")
        if exponent.gradient and not plain:
            raise QuantityError(f"a number, no parameter, as exponent of what has a unit: {self._at(node)}")
        if a == 0 and b < 0:
            raise QuantityError(f"a divisor that is not zero: {self._at(node)} divides by 0")
        if a < 0 and not b.is_integer():
            raise QuantityError(f"a whole power of a negative number: {self._at(node.left)} is {a:g}")
        # Units take powers that are fractions, of which an exponent is the float.
        power = Fraction(b).limit_denominator(24)
        if abs(power - Fraction(b)) > 1e-12 * max(1.0, abs(b)) and not plain:
            raise QuantityError(f"a simple fraction as exponent of what has a unit: {self._at(node.right)} is {b:g}")
        number = a**b
        unit = times({}, base.unit, power) if not exponent.gradient else {}
        return _chain(number, unit, (_slope(a, b), base), (_slope_by_exponent(a, b, number), exponent))

    def _apply(self, name: str, node: ast.Call, values: Sequence[Value]) -> Value:
        if name in ("min", "max"):
            unit = self._common(node, "compares {} with {}", *values)
            return _extreme(min if name == "min" else max, unit, values)
        (value,) = values
        x = value.number
        if name == "abs":
            return _chain(abs(x), value.unit, (math.copysign(1.0, x) if x else math.nan, value))
        if (name == "sqrt" and x < 0) or (name == "log" and x <= 0):
            limit = "not negative" if name == "sqrt" else "positive"
            raise QuantityError(f"an argument that is {limit}: {self._at(node)} has {x:g}")
        if name == "sqrt":
            root = math.sqrt(x)
            return _chain(root, times({}, value.unit, Fraction(1, 2)), (0.5 / root if root else math.nan, value))
        if not alike(value.unit, {}):
            raise QuantityError(f"a plain number or an angle: {self._at(node)} has {_shown(value.unit)}")
        function, slope = _PLAIN[name]
        y = function(x)
        return _chain(y, {"radian": 1} if name == "atan" else {}, (slope(x, y), value))


def _slope(a: float, b: float) -> float:
    """Derivative of a^b by a."""
    try:
        return b * a ** (b - 1.0) if b else 0.0
    except (OverflowError, ZeroDivisionError):
        return math.nan


def _slope_by_exponent(a: float, b: float, power: float) -> float:
    """Derivative of a^b by b."""
    if a > 0:
        return power * math.log(a)
    return 0.0 if a == 0 and b > 0 else math.nan


def _extreme(chosen: Callable[[Iterable[float]], float], unit: Unit, values: Sequence[Value]) -> Value:
    """The least or largest; where several are, and differ in a derivative, there is none."""
    number = chosen(value.number for value in values)
    reached = [value.gradient for value in values if value.number == number]
    slopes = {name: {gradient.get(name, 0.0) for gradient in reached} for some in reached for name in some}
    return Value(number, unit, {name: found.pop() if len(found) == 1 else math.nan for name, found in slopes.items()})


def unknown_name(name: str, known: Iterable[str], what: str = "parameter") -> QuantityError:
    """The refusal of a name that is not known."""
    names = list(known)
    close = [k for k in names if k.lower() == name.lower()] or difflib.get_close_matches(name, names, n=1)
    if close:
        hint = f"did you mean {close[0]!r}?"
    else:
        hint = f"one of {', '.join(names[:20])}{', ...' if len(names) > 20 else ''}" if names else "there is none"
    return QuantityError(f"a known {what} in place of {name!r}: {hint}", UnknownName(name))


def is_expression(given: object) -> bool:
    """Whether a field's value is an expression, and not a quantity.

    What begins with a number and is a quantity is one; any other text is an expression.

    Examples
    --------
    >>> [is_expression(given) for given in ("5 mm", "-3", 2.0, "Kp", "2*Kp", "11/J")]
    [False, False, False, True, True, True]
    """
    return isinstance(given, str) and _is_no_quantity(given)


@lru_cache(maxsize=4096)
def _is_no_quantity(text: str) -> bool:
    try:
        parse_any(text)
    except NoQuotient:
        return False
    except QuantityError:
        return True
    return False


def is_expression_of(given: object, known: Container[str]) -> bool:
    """Whether a field's value is an expression that uses no other names than these.

    Examples
    --------
    >>> given = ("2*Kp", "tustin", "2*pi", "1 s", "a.csv")
    >>> [is_expression_of(text, {"Kp": 2.0}) for text in given]
    [True, False, True, False, False]
    """
    try:
        return is_expression(given) and all(name in known for name in parse(str(given)).names)
    except QuantityError:
        return False


@lru_cache(maxsize=4096)
def parse(text: str) -> Expression:
    """Read an expression.

    Raises
    ------
    QuantityError
        If it is none: too long, with what is no arithmetic, or with a function that is not known.

    Examples
    --------
    >>> parse("sqrt(k/J)").names
    ('k', 'J')
    """
    if len(text) > LONGEST:
        raise QuantityError(f"{_WANTED}, at most {LONGEST} characters long")
    plain = text.translate(SPELLINGS).strip().replace("^", "**")
    try:
        # Python's parser sees nothing but tokens of arithmetic.
        if not _TOKENS.fullmatch(plain):
            raise QuantityError(_wanted(text))
        tree = ast.parse(plain, mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise QuantityError(_wanted(text)) from None
    names: dict[str, None] = {}
    _check(tree, text, names, 0)
    return Expression(plain.replace("**", "^"), tuple(names), tree)


def _wanted(text: str) -> str:
    """What a text should be that is no expression; where it holds or begins with a quantity, how that is written."""
    if likely := meant(text):
        return f"a quantity: did you mean {likely!r}?"
    try:
        parse_any(text)
    except UnknownUnit as error:
        return error.expected
    except QuantityError:
        pass
    if not (found := _QUANTITY.search(text)):
        return _WANTED
    number, name = found.groups()
    quantity = f"{number} {name}"
    try:
        parse_any(quantity)
    except QuantityError:
        # A unit written as on a data sheet, "2.7 mNm", is a quantity still and no parameter behind a number.
        if not (likely := meant(quantity)):
            return f"an expression with a sign between {number} and {name}, as in '{number}*{name}'"
        quantity = likely
    return f"an expression of numbers and parameters: give '{quantity}' a name in [parameters], and write that here"


def _check(node: ast.expr, text: str, names: dict[str, None], depth: int) -> None:
    """Refuse all but arithmetic; `names` grows by those that are used."""
    if depth > DEEPEST:
        raise QuantityError(f"an expression of at most {DEEPEST} operations inside one another")
    inner: list[ast.expr] = []
    if isinstance(node, ast.Name):
        if node.id in FUNCTIONS:
            raise QuantityError(f"an argument of {node.id}, as in '{node.id}(x)'")
        if node.id != "pi":
            names[node.id] = None
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        _check_call(node.func.id, len(node.args))
        inner = node.args
    elif isinstance(node, ast.BinOp) and isinstance(node.op, _OPERATORS):
        inner = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        inner = [node.operand]
    elif not (isinstance(node, ast.Constant) and type(node.value) in (int, float)):
        raise QuantityError(_wanted(text))
    for part in inner:
        _check(part, text, names, depth + 1)


def _check_call(name: str, count: int) -> None:
    if name not in FUNCTIONS:
        raise unknown_name(name, FUNCTIONS, "function")
    if name in ("min", "max"):
        if count < 2:
            raise QuantityError(f"two or more arguments of {name}")
    elif count != 1:
        raise QuantityError(f"one argument of {name}")
