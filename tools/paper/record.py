"""All figures of the paper's experiments as JSON can hold them."""

import math
from collections.abc import Sequence
from dataclasses import asdict

from tools.command_line.text_table import describe_machine
from tools.paper.experiments import PaperResults, PaperSettings


def record_of(results: PaperResults, settings: PaperSettings, command: str) -> dict[str, object]:
    """Return every number that was measured, by table; null where there is none."""
    studies = [
        {
            **variant._asdict(),
            "rows": [
                {
                    **setting._asdict(),
                    "shares": [_number(share) for share in shares.tolist()],
                    "matches": study.matches[setting].tolist(),
                }
                for setting, shares in study.shares.items()
            ],
            "found": {str(asked): counts.tolist() for asked, counts in study.found.items()},
        }
        for variant, study in results.studies.items()
    ]
    return {
        "command": command,
        "settings": asdict(settings),
        "machine": describe_machine(),
        "table_1": {
            pair: {name: _numbers(list(asdict(result).items())) for name, result in by.items()}
            for pair, by in results.detectors.items()
        },
        "table_2": studies,
        "table_3": {pair: asdict(result) for pair, result in results.transforms.items()},
        "table_4": {
            pair: {"area_m2": result.area_m2, "milliseconds": result.milliseconds.tolist()}
            for pair, result in results.durations.items()
        },
    }


def _numbers(items: Sequence[tuple[str, float]]) -> dict[str, float | None]:
    return {key: _number(value) for key, value in items}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
