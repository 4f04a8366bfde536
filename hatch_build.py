"""The layout of a wheel, and the addresses on its page.

`datasets` and `tools` are names that other projects install too. In a wheel they are `tbmslam.datasets` and
`tbmslam.tools`; the imports of them are written accordingly while it is built.
The source tree and an editable install keep the short names.

Wheels are released by a workflow of the forge that holds the project, which states the address of the project.
"""

import ast
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

HOMES = {"tbmslam": "tbmslam", "merging": "merging", "datasets": "tbmslam/datasets", "tools": "tbmslam/tools"}
MOVED = tuple(package for package, home in HOMES.items() if package != home)


class CustomBuildHook(BuildHookInterface[Any]):
    """Puts the packages where a wheel has them."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the sources of a wheel to be, and have them included."""
        if self.target_name != "wheel" or version != "standard":
            return
        root, staging = Path(self.root), Path(tempfile.mkdtemp())
        self._staging = staging
        for package, home in HOMES.items():
            for source in sorted((root / package).rglob("*")):
                if source.is_file() and "__pycache__" not in source.parts:
                    target = staging / home / source.relative_to(root / package)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    if source.suffix == ".py":
                        target.write_text(for_wheel(source), encoding="utf-8")
                    else:
                        shutil.copyfile(source, target)
        for package in sorted({home.partition("/")[0] for home in HOMES.values()}):
            build_data["force_include"][str(staging / package)] = package

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was only for the build."""
        del version, build_data, artifact_path
        if hasattr(self, "_staging"):
            shutil.rmtree(self._staging)


def for_wheel(source: Path) -> str:
    """Return a module as it is in a wheel."""
    text = source.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import) and any(name.name.partition(".")[0] in MOVED for name in node.names):
            raise ValueError(
                f"{source}:{node.lineno}: write `from ... import` for {' and '.join(MOVED)}: wheels move them"
            )
        if isinstance(node, ast.ImportFrom) and not node.level and str(node.module).partition(".")[0] in MOVED:
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line[: node.col_offset] + re.sub(
                r"^from (\w+)", r"from tbmslam.\1", line[node.col_offset :]
            )
    return "".join(lines)


_PAPER = "https://ceur-ws.org/Vol-2953/SEIM_2021_paper_17.pdf"
_RELATIVE_LINK = re.compile(r"(!?)(\[[^\]]*\]\()(?!\w+:|#)")


class CustomMetadataHook(MetadataHookInterface):
    """Writes the addresses of the project, and a README whose links work outside the source tree."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add `urls` and `readme`."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["urls"] = {"Paper": _PAPER}
        server, name = os.environ.get("GITHUB_SERVER_URL"), os.environ.get("GITHUB_REPOSITORY")
        if server and name:
            home, version = f"{server}/{name}", os.environ.get("GITHUB_REF_NAME", "HEAD")
            pages = {"Documentation": f"blob/{version}/docs/index.md", "Changelog": f"blob/{version}/CHANGELOG.md"}
            metadata["urls"] |= {"Source": home, "Issues": f"{home}/issues"}
            metadata["urls"] |= {title: f"{home}/{page}" for title, page in pages.items()}
            text = absolute_links(text, home, version)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def absolute_links(text: str, home: str, version: str) -> str:
    """Return Markdown whose relative links lead to a version of the project; pictures lead to their files."""
    return _RELATIVE_LINK.sub(lambda link: f"{link[1]}{link[2]}{home}/{'raw' if link[1] else 'blob'}/{version}/", text)
