"""Units (FMU) of `unit.c`, compiled and zipped."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import fmpy

_SOURCE, _ARRAYS = (Path(__file__).with_name(name) for name in ("unit.c", "state_space.c"))
#: Models of the source.
MODELS = {"drive": 1, "pendulum": 2, "limited": 3, "oscillator": 4}
STATES, RATES = ("angle_state", "speed_state"), ("angle_rate", "speed_rate")
INPUTS, OUTPUTS = ("torque", "load"), ("angle", "speed", "acceleration")
#: What the drive's rpm are in the description: a unit with a factor.
RPM = 0.1047


def _units() -> str:
    base = f'<BaseUnit rad="1" s="-1" factor="{RPM}"/>'
    return f'<UnitDefinitions><Unit name="1/min">{base}</Unit><Unit name="rad/s2"/></UnitDefinitions>'


def _description(model: str, version: int, kind: str, directional: bool) -> str:
    own, token = ("ScalarVariable", "guid") if version == 2 else ("Float64", "instantiationToken")
    units = {"speed": "1/min", "acceleration": "rad/s2"} if model == "drive" else {}
    rows = []
    # States of the oscillator are outputs themselves, as those of the reference unit are.
    names = [(n, "output" if model == "oscillator" else "local") for n in STATES]
    names += [(n, "local") for n in RATES] + [(n, "input") for n in INPUTS]
    names += [(n, "output") for n in OUTPUTS] + [("mu" if model == "oscillator" else "inertia", "parameter")]
    for k, (name, causality) in enumerate(names):
        variability = "fixed" if causality == "parameter" else "continuous"
        about = f'name="{name}" valueReference="{k}" causality="{causality}" variability="{variability}"'
        more = f' derivative="{k - 1 if version == 2 else k - 2}"' if name in RATES else ""
        if causality in ("input", "parameter") or name in STATES:
            more += ' start="0.5"' if causality == "parameter" else ' start="0"'
            about += ' initial="exact"' if causality != "input" else ""
        more += f' unit="{units[name]}"' if name in units else ""
        rows.append(f"<{own} {about}><Real{more}/></{own}>" if version == 2 else f"<{own} {about}{more}/>")
    if version == 2:
        structure = '<Outputs><Unknown index="7"/><Unknown index="8"/><Unknown index="9"/></Outputs>'
        structure += '<Derivatives><Unknown index="3"/><Unknown index="4"/></Derivatives>'
        structure += "<InitialUnknowns>" + "".join(f'<Unknown index="{i}"/>' for i in (3, 4, 7, 8, 9))
        structure += "</InitialUnknowns>"
        indicators = ' numberOfEventIndicators="1"' if model == "limited" else ""
    else:
        rows.append('<Float64 name="time" valueReference="10" causality="independent" variability="continuous"/>')
        references = [("Output", k) for k in (6, 7, 8)] + [("ContinuousStateDerivative", k) for k in (2, 3)]
        references += [("InitialUnknown", k) for k in (2, 3, 6, 7, 8)]
        structure = "".join(f'<{what} valueReference="{k}"/>' for what, k in references)
        structure += '<EventIndicator valueReference="4"/>' if model == "limited" else ""
        indicators = ""
    word = "providesDirectionalDerivative" if version == 2 else "providesDirectionalDerivatives"
    return (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="{version}.0" modelName="{model}" {token}="token"'
        f"{indicators}>"
        f'<{kind} modelIdentifier="unit" {word}="{str(directional).lower()}"/>{_units()}'
        f"<ModelVariables>{''.join(rows)}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    )


def _arrays(directional: bool) -> str:
    """Of `state_space.c`; FMI 3."""
    n, no_time = '<Dimension valueReference="0"/>', 'causality="parameter" variability="tunable"'
    rows = ['<UInt64 name="n" valueReference="0" causality="structuralParameter" variability="tunable" start="3"/>']
    for k, (name, about, size) in enumerate([
        ("x", 'causality="local" variability="continuous" initial="exact" start="0 0 0"', n),
        ("der(x)", 'causality="local" variability="continuous" derivative="1"', n),
        ("u", 'causality="input" variability="discrete" start="1 2 3"', n),
        ("y", 'causality="output" variability="continuous"', n),
        *((name, f'{no_time} start="1 0 0 0 1 0 0 0 1"', 2 * n) for name in "ABCD"),
    ]):  # fmt: skip
        rows.append(f'<Float64 name="{name}" valueReference="{k + 1}" {about}>{size}</Float64>')
    rows.append('<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>')
    structure = '<Output valueReference="4"/><ContinuousStateDerivative valueReference="2"/>'
    structure += '<InitialUnknown valueReference="2"/><InitialUnknown valueReference="4"/>'
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="3.0" modelName="state_space" instantiationToken="token">'
        f'<ModelExchange modelIdentifier="unit" providesDirectionalDerivatives="{str(directional).lower()}"/>'
        f"<ModelVariables>{''.join(rows)}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    )


def make(
    folder: Path,
    model: str,
    version: int,
    *,
    kind: str = "ModelExchange",
    directional: bool = True,
    platform: str | None = None,
) -> Path:
    """A unit of a model."""
    library = folder / f"{model}{directional}{fmpy.sharedLibraryExtension}"
    if not library.exists():
        flags = [f"-DMODEL={MODELS.get(model, 0)}", f"-DDIRECTIONAL={int(directional)}"]
        source = _ARRAYS if model == "state_space" else _SOURCE
        subprocess.run(["cc", "-shared", "-fPIC", *flags, str(source), "-o", str(library), "-lm"], check=True)
    path = folder / f"{model}{version}{kind}{directional}{platform or ''}.fmu"
    here = platform or (fmpy.platform if version == 2 else fmpy.platform_tuple)
    with zipfile.ZipFile(path, "w") as archive:
        described = _arrays(directional) if model == "state_space" else _description(model, version, kind, directional)
        archive.writestr("modelDescription.xml", described)
        archive.write(library, f"binaries/{here}/unit{fmpy.sharedLibraryExtension}")
    return path
