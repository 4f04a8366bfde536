"""The reproduction's report: one HTML file of sections with tables and pictures, which needs nothing else."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field

_TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{{ title }}</title><style>
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1c1c1c }
h1 { font-size: 1.7rem } h2 { margin-top: 3rem; border-bottom: 1px solid #bbb } p { max-width: 50rem }
.wide { overflow-x: auto } table { border-collapse: collapse; font-size: .88rem; margin: 1rem 0 }
caption { text-align: left; font-weight: 600; padding: .3rem 0 }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #ddd; text-align: right; vertical-align: top;
 white-space: nowrap }
th:first-child, td:first-child { text-align: left } thead th { border-bottom: 2px solid #777; vertical-align: bottom }
td .theirs { display: block; color: #666; font-size: .82em } tr:hover { background: #f5f5f5 }
figure { margin: 1.5rem 0 } img { max-width: 100%; border: 1px solid #ccc } figcaption { font-size: .88rem }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem } .pictures figure { margin: 0; flex: 0 1 20rem }
.wide-picture { flex: 1 1 100% !important }
pre { white-space: pre-wrap; font-size: .8rem; background: #f5f5f5; padding: 1rem }
@media (prefers-color-scheme: dark) { body { background: #181818; color: #ddd } td .theirs { color: #999 }
 tr:hover, pre { background: #262626 } th, td { border-color: #444 } }
</style></head><body>
<h1>{{ title }}</h1>
{% for text in lead %}<p>{{ text }}</p>
{% endfor %}
{% for section in sections %}
<section><h2>{{ section.title }}</h2>
{% for text in section.texts %}<p>{{ text }}</p>
{% endfor %}
{% for table in section.tables %}
<div class="wide"><table><caption>{{ table.title }}</caption>
<thead><tr>{% for head in table.heads %}<th scope="col">{{ head }}</th>{% endfor %}</tr></thead><tbody>
{% for row in table.rows %}<tr>{% for cell in row %}
<td>{% for line in cell.split("\\n") %}{% if loop.first %}{{ line }}{% else %}<span class="theirs">{{ line }}</span>\
{% endif %}{% endfor %}</td>{% endfor %}</tr>
{% endfor %}</tbody></table></div>
{% endfor %}
{% if section.pictures %}<div class="pictures">
{% for picture in section.pictures %}<figure{% if picture.wide %} class="wide-picture"{% endif %}>
<img alt="{{ picture.caption }}" src="data:image/png;base64,{{ picture.base64 }}">
<figcaption>{{ picture.caption }}</figcaption></figure>
{% endfor %}</div>{% endif %}
</section>
{% endfor %}
</body></html>
"""


@dataclass(frozen=True)
class PaperTable:
    """Rows of text; in a cell, lines after the first are what the paper has."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class PaperPicture:
    """A PNG with what is seen on it; wide ones take the whole line."""

    png: bytes
    caption: str
    wide: bool = False

    @property
    def base64(self) -> str:
        """The picture as text."""
        return base64.b64encode(self.png).decode("ascii")


@dataclass(frozen=True)
class Section:
    """A table or figure of the paper: sentences, tables and pictures."""

    title: str
    texts: Sequence[str] = ()
    tables: Sequence[PaperTable] = field(default_factory=tuple)
    pictures: Sequence[PaperPicture] = field(default_factory=tuple)


def paper_page(title: str, lead: Sequence[str], sections: Sequence[Section]) -> str:
    """Return the page; every text is text in it and never markup."""
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(_TEMPLATE).render(title=title, lead=lead, sections=sections)
