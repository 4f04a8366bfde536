import json
import re
from pathlib import Path

import pytest

from tests.faults import faults
from tests.mutation import mutants
from tools import benchmark, figures, make_map_pairs
from tools.figures import FigureError, fill, main, pages, read_records, write_record

ROOT = Path(__file__).resolve().parents[2]
RECORDS = read_records(ROOT / "docs" / "figures")
TABLE = {"columns": ["drive", "preset", "error m", "pairs"], "rows": [["aces", "tiny", "0.03", "3 of 4"]]}
GIVEN = {"slam": {"commands": [], "commit": "abc1234", "date": "2026-11-23", "tables": {"drives": TABLE}}}


@pytest.mark.parametrize("page", pages(ROOT), ids=lambda page: page.name)
def test_every_page_has_the_figures_of_its_files(page):
    text = page.read_text("utf-8")
    assert fill(text, RECORDS, page.name) == text, "run: python tools/figures.py fill"


def test_every_file_of_figures_is_shown_with_its_origin():
    text = "\n".join(page.read_text("utf-8") for page in pages(ROOT))
    shown = set(re.findall(r"<!-- (?:table|figure): ([\w-]+)/", text))
    assert shown == set(RECORDS)
    for name, record in RECORDS.items():
        assert record["commit"], name
        for table in record["tables"].values():
            assert all(len(row) == len(table["columns"]) for row in table["rows"])


GRAMMARS = {
    "tools/benchmark.py": benchmark.parser(),
    "tests/faults/faults.py": faults.parser(),
    "tools/make_map_pairs.py": make_map_pairs._parser(),
    "tests/mutation/mutants.py": mutants.parser(),
}


@pytest.mark.parametrize("name", RECORDS)
def test_the_commands_are_understood(name):
    for command in RECORDS[name]["commands"]:
        python, program, *words = command.split()
        assert python == "python"
        GRAMMARS[program].parse_args(words)


def test_a_table_shows_the_columns_it_is_asked_for():
    text = "a\n<!-- table: slam/drives | drive | error m -->\nold\n<!-- /table -->\nb"
    assert fill(text, GIVEN, "x.md") == (
        "a\n<!-- table: slam/drives | drive | error m -->\n"
        "| drive | error m |\n|---|--:|\n| aces | 0.03 |\n\n<sub>Measured at abc1234.</sub>\n<!-- /table -->\nb"
    )
    whole = fill("<!-- table: slam/drives -->\n<!-- /table -->", GIVEN, "x.md")
    assert "| drive | preset | error m | pairs |\n|---|---|--:|--:|\n| aces | tiny | 0.03 | 3 of 4 |" in whole
    assert fill(whole, GIVEN, "x.md") == whole


def test_a_figure_is_one_cell():
    text = "off by <!-- figure: slam/drives/aces/error m -->7<!-- /figure --> m"
    assert fill(text, GIVEN, "x.md") == "off by <!-- figure: slam/drives/aces/error m -->0.03<!-- /figure --> m"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- table: slam/robots -->\n<!-- /table -->", "x.md: docs/figures has no table slam/robots"),
        ("<!-- table: split/drives -->\n<!-- /table -->", "x.md: docs/figures has no table split/drives"),
        (
            "<!-- table: slam/drives | ate -->\n<!-- /table -->",
            "slam/drives has no column 'ate'; there are drive, preset",
        ),
        (
            "<!-- figure: slam/drives/intel/error m -->1<!-- /figure -->",
            "slam/drives has no row 'intel'; there are aces",
        ),
        ("<!-- figure: slam/drives/aces/ate -->1<!-- /figure -->", "slam/drives has no column 'ate'"),
        ("<!-- figure: slam/drives -->1<!-- /figure -->", "a figure is FILE/TABLE/ROW/COLUMN, not slam/drives"),
        ("<!-- table: slam/drives -->\n| a |\n", "x.md: a marker of a table or figure has no end, or no begin"),
        ("0.3<!-- /figure -->", "x.md: a marker of a table or figure has no end, or no begin"),
    ],
)
def test_a_marker_that_leads_nowhere_is_an_error(text, message):
    with pytest.raises(FigureError, match=re.escape(message)):
        fill(text, GIVEN, "x.md")


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A checkout with one figure and a program that measures it."""
    (tmp_path / "docs" / "figures").mkdir(parents=True)
    (tmp_path / "README.md").write_text("<!-- table: slam/drives | drive -->\n<!-- /table -->\n")
    (tmp_path / "program.py").write_text(
        "import json, pathlib, sys\n"
        "name, data, _, out = sys.argv[1:]\n"
        "rows = [[name, pathlib.Path(data).read_text()]]\n"
        "tables = {'drives': {'columns': ['drive', 'text'], 'rows': rows}}\n"
        "pathlib.Path(out).write_text(json.dumps({'commit': 'new', 'date': 'today', 'tables': tables}))\n"
    )
    command = "python program.py aces $DATA/aces.bag"
    write_record(tmp_path / "docs/figures/slam.json", {**GIVEN["slam"], "commands": [command]})
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    return tmp_path


def test_a_figure_is_measured_and_the_page_filled(root, capsys):
    (root / "aces.bag").write_text("1")
    assert main(["measure", "slam", "--data", str(root)]) == 0
    record = json.loads((root / "docs/figures/slam.json").read_text())
    assert record["commands"] == ["python program.py aces $DATA/aces.bag"]
    assert (record["commit"], record["tables"]["drives"]["rows"]) == ("new", [["aces", "1"]])
    assert "| aces |" in (root / "README.md").read_text()
    assert main(["list"]) == 0
    assert capsys.readouterr().out == "slam (new, today)\n    python program.py aces $DATA/aces.bag\n"


def test_a_figure_without_its_recording_is_skipped(root, capsys):
    before = (root / "docs/figures/slam.json").read_bytes()
    assert main(["measure", "--data", str(root / "nowhere")]) == 0
    assert f"figures: slam skipped: {root / 'nowhere' / 'aces.bag'} is absent" in capsys.readouterr().err
    assert (root / "docs/figures/slam.json").read_bytes() == before


def test_a_benchmark_that_fails_leaves_the_figure_as_it_was(root, capsys):
    before = (root / "docs/figures/slam.json").read_bytes()
    (root / "aces.bag").mkdir()
    assert main(["measure", "--data", str(root)]) == 1
    assert "slam: program.py failed; the figure stays as it was" in capsys.readouterr().err
    assert (root / "docs/figures/slam.json").read_bytes() == before


def test_a_figure_that_does_not_exist_is_one_line(root, capsys):
    assert main(["measure", "speed"]) == 1
    assert capsys.readouterr().err == "figures: there is no figure 'speed'; there are slam\n"


def test_a_row_is_a_line(tmp_path):
    write_record(tmp_path / "x.json", GIVEN["slam"])
    text = (tmp_path / "x.json").read_text()
    assert '    [ "aces", "tiny", "0.03", "3 of 4"]\n' in text
    assert json.loads(text) == GIVEN["slam"]
