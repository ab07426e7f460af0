"""The command ``eppanalysis response``: what a loop does when a sine drives it, at one frequency or over a range."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from eppanalysis.cli.common import (
    NOTHING,
    CaseName,
    Json,
    Output,
    Settings,
    answer,
    check_output,
    echo,
    load_case,
    print_table,
    progress,
    range_of,
    write_output,
)
from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.cases import Case


def response(
    case: CaseName,
    amplitude: Annotated[
        str | None,
        typer.Option("--amplitude", metavar="VALUE", help='Of the sine, as in 0.5 or "5 mm"; or LOW..HIGH.'),
    ] = None,
    frequency: Annotated[
        str | None,
        typer.Option("--frequency", metavar="VALUE", help="Of the sine [Hz], as in 0.8; or LOW..HIGH."),
    ] = None,
    input: Annotated[
        str | None, typer.Option("--input", metavar="NAME", help="The input that is driven.", show_default=False)
    ] = None,
    signal: Annotated[
        str | None, typer.Option("--signal", metavar="NAME", help="The output to show.", show_default=False)
    ] = None,
    settings: Settings = NOTHING,
    as_json: Json = False,
    output: Output = None,
) -> None:
    """Say how a loop answers a sine: periodic responses, stable and unstable, and over a range their folds."""
    from eppanalysis.methods.driven.result import ForcedResponse
    from eppanalysis.tables.files import response_table

    check_output(output)
    found = load_case(case, settings)
    name, shown = signal or found.expected.signal, [signal] if signal else list(found.named_signals)
    with progress(f"response {found.name}"):
        result = _analysed(found, input, name, amplitude, frequency)
    answer("response", found, settings, as_json, result, lambda: _show(result, shown))
    write_output(output, result, response_table, **({"signals": shown} if isinstance(result, ForcedResponse) else {}))


def _analysed(found: Case, input: str | None, signal: str | None, amplitude: str | None, frequency: str | None) -> Any:
    """The analysis that the two options choose: over a frequency, over an amplitude, or at one sine."""
    from eppanalysis.methods.driven.forced import forced_response
    from eppanalysis.methods.driven.frequency import amplitude_response, frequency_response

    sizes = _numbers("--amplitude", amplitude, _unit_of(found, input))
    rates = _numbers("--frequency", frequency, "Hz")
    if len(sizes) > 1 and len(rates) > 1:
        raise EppError(f"--amplitude {amplitude} --frequency {frequency}: are two ranges; expected one at most.")
    size, rate = sizes[0] if sizes else None, rates[0] if rates else None
    if len(rates) > 1:
        return frequency_response(found, input, signal, amplitude=size, frequencies=(rates[0], rates[1]))
    if len(sizes) > 1:
        return amplitude_response(found, input, signal, frequency=rate, amplitudes=(sizes[0], sizes[1]))
    return forced_response(found, input, amplitude=size, frequency=rate)


def _unit_of(found: Case, input: str | None) -> str:
    """SI unit of the input that is driven; of a diagram's it is that of the signal of its name."""
    system = found.to_system()
    name = system.input_names[0] if input is None and len(system.input_names) == 1 else input
    units = system.signals.units_by_name()
    return units.get(name or "", "") or found.input_units.get(name or "", "")


def _numbers(option: str, text: str | None, unit: str) -> list[float]:
    """No, one or two SI numbers of an option that takes a quantity or a range of them."""
    from eppanalysis.units import QuantityError, parse_quantity

    if text is None:
        return []
    try:
        return [parse_quantity(part, unit) for part in range_of(text) or (text.strip(),)]
    except QuantityError as error:
        raise EppError(f"{option} {text}: expected {error.expected}, or two with '..' between them.") from None


def _show(result: Any, signals: list[str]) -> None:
    from eppanalysis.methods.driven.result import ForcedResponse
    from eppanalysis.tables.console import forced_table, special_responses_table

    echo(str(result))
    if isinstance(result, ForcedResponse):
        if len(result):
            print_table(forced_table(result, signals))
    elif any(branch.special for branch in result.branches):
        print_table(special_responses_table(result))
