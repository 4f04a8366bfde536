"""What is drawn to test the tests: small faults, each of which leaves valid code that differs in one place."""

import ast
import textwrap
import tomllib

import pytest

from tests.mutation.mutants import HERE, ROOT, drawn, equivalent, nearest_tests, scores
from tests.mutation.mutations import Mutation, mutated, mutations

SOURCE = textwrap.dedent(
    """\
    import math


    def f(x: float, names: list[str]) -> float:
        \"\"\"Say 1 + 1 < 3.\"\"\"
        if x < 2.0 and not names:
            raise ValueError(f"{x + 1} is too small")
        for name in names:
            logger.info("%d", x + 1)
            if name == "a":
                continue
            x -= min(x, 3) ** 2
        return -x if True else math.sin(x)
    """
)


def test_every_operator_makes_its_mutations():
    found = {(mutation.line, mutation.before.strip(), mutation.after) for mutation in mutations(SOURCE.encode())}
    assert found == {
        (6, "<", "<="),
        (6, "2.0", "4.0"),
        (6, "and", "or"),
        (6, "not", ""),
        (9, 'logger.info("%d", x + 1)', "pass"),  # which nobody notices, but may be the only call of its kind
        (10, "==", "!="),
        (11, "continue", "break"),
        (12, "-=", "+="),
        (12, "min", "max"),
        (12, "3", "4"),
        (12, "**", "*"),
        (12, "2", "3"),
        (13, "-", ""),
        (13, "True", "False"),
        (13, "sin", "cos"),
    }


def test_a_mutated_module_differs_in_one_line_and_can_be_read():
    before = SOURCE.splitlines()
    for mutation in mutations(SOURCE.encode()):
        after = mutated(SOURCE.encode(), mutation).decode()
        ast.parse(after)
        changed = [
            number for number, pair in enumerate(zip(before, after.splitlines(), strict=True), 1) if pair[0] != pair[1]
        ]
        assert changed == [mutation.line]


def test_a_mutation_is_found_again_after_lines_moved():
    mutation = Mutation(13, "    return -x if True else math.sin(x)", 11, "-", "")
    assert mutated(b"\n\n" + SOURCE.encode(), mutation).endswith(b"    return x if True else math.sin(x)\n")
    with pytest.raises(ValueError, match="no line says 'return 0' any more"):
        mutated(SOURCE.encode(), Mutation(13, "    return 0", 11, "0", "1"))


def test_every_place_of_an_area_exists():
    areas = tomllib.loads((HERE / "areas.toml").read_text(encoding="utf-8"))
    assert [place for places in areas.values() for place in places if not (ROOT / place).exists()] == []


def test_those_drawn_can_still_be_planted_or_are_accounted_for():
    mutants, reasons = drawn(), equivalent()
    assert len(mutants) >= 300
    assert set(reasons) <= {mutant.name for mutant in mutants}
    for mutant in mutants:
        if mutant.name not in reasons:
            assert mutated((ROOT / mutant.path).read_bytes(), mutant.mutation)
            assert nearest_tests(mutant.path), mutant


def test_the_score_counts_what_was_tried():
    mutants = [mutant for mutant in drawn() if mutant.name in ("loops-0", "loops-1", "grids-2", "grids-5")]
    rows = {row[0]: row[1:] for row in scores(mutants, {"loops-0": True, "loops-1": False, "grids-5": True}).rows}
    assert rows == {
        "loops": ["2", "0", "1", "1", "50.0%"],
        "grids": ["2", "1", "1", "0", "100.0%"],
        "all": ["4", "1", "2", "1", "66.7%"],
    }
