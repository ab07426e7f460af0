"""The public face: light to import, complete, typed; and the floors of the package."""

from __future__ import annotations

import ast
import ctypes
import importlib.metadata
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import eppanalysis

ROOT = Path(eppanalysis.__file__).parent
HEAVY = ("casadi", "control", "matplotlib", "pandas", "pint", "pydantic", "rich", "scipy", "typer", "xarray")


def run_python(code: str) -> str:
    """Output of a fresh interpreter, which has imported nothing yet."""
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.slow
def test_import_is_light():
    code = f"import sys, eppanalysis; print([m for m in {HEAVY!r} if m in sys.modules])"
    assert run_python(code) == "[]"


@pytest.mark.slow
def test_command_line_imports_nothing_that_computes():
    heavy = tuple(m for m in HEAVY if m not in ("rich", "typer"))
    code = f"import sys, eppanalysis.cli; print([m for m in {heavy!r} if m in sys.modules])"
    assert run_python(code) == "[]"


@pytest.mark.slow
def test_predictions_and_searches_load_no_splines_and_no_optimisers():
    """Of scipy they took more time to load than a loop of one element takes to be searched; margins are of both."""
    heavy = ("control", "matplotlib", *(f"scipy.{m}" for m in ("fft", "interpolate", "optimize", "sparse", "spatial")))
    work = "import sys, eppanalysis as epp; case = epp.case('sat_khalil710')"
    work += "; dict(epp.predict_limit_cycles(case).margins); epp.find_limit_cycles(case)"
    assert run_python(f"{work}; print([m for m in {heavy!r} if m in sys.modules])") == "[]"


def test_every_public_name_resolves():
    for name in dir(eppanalysis):
        assert getattr(eppanalysis, name) is not None


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Backlash'"):
        eppanalysis.Backlash  # noqa: B018


def test_type_checkers_see_what_there_is_at_run_time():
    """The stub names every public name once, with the module that holds it."""
    stub = ast.parse((ROOT / "__init__.pyi").read_text())
    aliases = [alias for statement in stub.body if isinstance(statement, ast.ImportFrom) for alias in statement.names]
    names = [alias.name for alias in aliases]
    assert all(alias.asname == alias.name for alias in aliases), "others are private to a stub"
    assert len(names) == len(set(names)) and {*names, "__version__"} == set(dir(eppanalysis))
    assert not {ast.unparse(s) for s in stub.body if not isinstance(s, ast.ImportFrom | ast.Expr)} - {
        "__version__: str"
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "first",
    [
        "import eppanalysis.cases",
        "from eppanalysis.cases import Case",
        "from eppanalysis import case",
    ],
)
def test_case_is_the_function_whatever_was_imported_before(first):
    code = f"{first}\nimport eppanalysis as epp\nfrom eppanalysis.cases import Case\n"
    assert run_python(code + "print(type(epp.case).__name__, Case.__name__)") == "function Case"


def test_version_is_that_of_the_distribution():
    assert importlib.metadata.version("eppanalysis") == eppanalysis.__version__


def test_package_is_marked_as_typed():
    assert (ROOT / "py.typed").is_file()


REPOSITORY = ROOT.parent


def project() -> dict:
    """What ``pyproject.toml`` says, with the version, which only the package says."""
    said = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return said | {"version": eppanalysis.__version__}


def test_citation_is_of_this_version_and_licence():
    yaml = pytest.importorskip("yaml")
    cited = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    for name in ("version", "license", "keywords"):
        assert cited[name] == project()[name]
    assert cited["title"] == project()["name"] and cited["cff-version"] == "1.2.0"
    assert [author["name"] for author in cited["authors"]] == [author["name"] for author in project()["authors"]]
    assert {"message", "type"} <= set(cited)


def test_changes_begin_with_this_version():
    text = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## \[?(\d+\.\d+\.\d+)\]? - \d{4}-\d\d-\d\d$", text, re.MULTILINE)
    assert versions[0] == eppanalysis.__version__


def test_image_is_installed_as_the_readme_says_and_does_not_run_as_root():
    first = re.search(r"^```sh\n(.*?)\n```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    lines = (REPOSITORY / "Dockerfile").read_text(encoding="utf-8").splitlines()
    assert [line.removeprefix("RUN ") for line in lines if line.startswith("RUN ")] == [first[1]]
    (base,) = [line for line in lines if line.startswith("FROM ")]
    oldest = project()["requires-python"].removeprefix(">=")
    assert [*map(int, base.partition(":")[2].removesuffix("-slim").split("."))] >= [*map(int, oldest.split("."))]
    (user,) = [line.removeprefix("USER ") for line in lines if line.startswith("USER ")]
    assert int(user.partition(":")[0]) > 0 and lines.index(f"USER {user}") < len(lines) - 2


def test_links_of_the_readme_are_absolute_on_a_package_index():
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    whole = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    for change in whole["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(change["pattern"], change["replacement"], text)
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert links and all(link.startswith("https://") for link in links)
    assert all("/raw." in link for link in re.findall(r"!\[[^\]]*\]\(([^)]*)\)", text))


def test_links_of_the_readme_lead_somewhere():
    for link in re.findall(r"\]\(([^):#]*)(?:#[^)]*)?\)", (REPOSITORY / "README.md").read_text(encoding="utf-8")):
        assert (REPOSITORY / link).exists(), link


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands(shell):
    """As the script that `eppanalysis --install-completion` leaves with a shell asks for it."""
    words = {"COMP_WORDS": "eppanalysis predi", "COMP_CWORD": "1", "_TYPER_COMPLETE_ARGS": "eppanalysis predi"}
    asks = {"_EPPANALYSIS_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
    code = "import sys; sys.argv = ['eppanalysis']; from eppanalysis.cli import main; main()"
    run = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, env={**os.environ, **words, **asks}
    )
    assert "predict" in run.stdout and "simulate" not in run.stdout


def test_conda_recipe_has_what_the_package_says():
    yaml = pytest.importorskip("yaml")
    recipe = yaml.safe_load((REPOSITORY / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    ours, needs = project(), recipe["requirements"]
    built = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert recipe["context"] == {"name": ours["name"], "version": ours["version"]}
    assert needs["run"] == [f"python {ours['requires-python']}", *ours["dependencies"]]
    assert set(needs["host"]) == {"python", "pip", *built}
    assert '${{ compiler("cxx") }}' in needs["build"]
    (script,) = recipe["build"]["python"]["entry_points"]
    assert script == f"eppanalysis = {ours['scripts']['eppanalysis']}"
    assert recipe["about"]["license"] == ours["license"] and recipe["about"]["homepage"] == ours["urls"]["Homepage"]
    assert " ".join(recipe["about"]["summary"].split()) == ours["description"]


@pytest.mark.parametrize("version", [2, 3])
def test_library_of_units_is_installed(tmp_path, version):
    """What a unit carries was built with the package, and is one of either version."""
    path = eppanalysis.to_fmu(eppanalysis.case("backlash_servo"), tmp_path / "loop.fmu", version=version)
    with zipfile.ZipFile(path) as unit:
        (library,) = (name for name in unit.namelist() if name.startswith("binaries/"))
        unit.extract(library, tmp_path)
    told = getattr(ctypes.CDLL(str(tmp_path / library)), f"fmi{version}GetVersion")
    told.restype = ctypes.c_char_p
    assert told() == f"{version}.0".encode()
