"""Parts of a self-contained HTML page. Everything that is not markup is escaped here."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

STYLE = """
:root { color-scheme: light dark;
  --ink: #22242a; --soft: #666a74; --line: #dcdde2; --ground: #ffffff; --card: #f5f5f7; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6ea; --soft: #a0a3ad; --line: #3a3c44; --ground: #16181c; --card: #202329; }
}
body { margin: 0 auto; max-width: 1180px; padding: 24px; background: var(--ground); color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 26px; margin: 0; } h2 { font-size: 19px; margin: 36px 0 8px; border-bottom: 1px solid var(--line); }
p { margin: 6px 0; } .soft { color: var(--soft); }
.verdict { display: inline-block; margin: 10px 0; padding: 4px 12px; border-radius: 6px;
  color: #fff; font-weight: 600; }
.good { background: #2c8a4b; } .bad { background: #c43c34; } .unknown { background: #7a7d86; }
.cards { display: flex; flex-wrap: wrap; gap: 10px; margin: 14px 0; }
.card { background: var(--card); border-radius: 8px; padding: 10px 14px; min-width: 130px; }
.card b { display: block; font-size: 20px; } .card span { color: var(--soft); font-size: 13px; }
table { border-collapse: collapse; margin: 8px 0; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 12px 3px 0; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
td.n, th.n { text-align: right; } tr.broken td { color: #c43c34; font-weight: 600; }
figure { margin: 12px 0; } img { width: 100%; height: auto; border-radius: 6px; background: #fff; }
figcaption { color: var(--soft); font-size: 13px; }
pre { overflow: auto; max-height: 420px; background: var(--card); padding: 10px; border-radius: 6px; font-size: 12px; }
details { margin: 6px 0; } summary { cursor: pointer; }
"""


def document(title: str, parts: Sequence[str]) -> str:
    """A whole page; it refers to nothing outside of itself."""
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{escape(title)}</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph, of a class of the style sheet where one is named."""
    return f'<p class="{escape(kind)}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def verdict(text: str, kind: str) -> str:
    """The verdict, coloured ``good``, ``bad`` or ``unknown``."""
    return f'<div class="verdict {escape(kind)}">{escape(text)}</div>'


def cards(figures: Sequence[tuple[str, str]]) -> str:
    """Large figures: name and value."""
    items = "".join(
        f'<div class="card"><b>{escape(value)}</b><span>{escape(name)}</span></div>' for name, value in figures
    )
    return f'<div class="cards">{items}</div>'


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], broken: Sequence[bool] = ()) -> str:
    """A table; columns whose first entry reads as a number stand to the right, rows that are ``broken`` in red."""
    right = [bool(rows) and _is_number(rows[0][i]) for i in range(len(columns))]
    head = "".join(_cell("th", text, to_right) for text, to_right in zip(columns, right, strict=True))
    lines = []
    for i, row in enumerate(rows):
        cells = "".join(_cell("td", text, to_right) for text, to_right in zip(row, right, strict=True))
        lines.append(f'<tr class="broken">{cells}</tr>' if i < len(broken) and broken[i] else f"<tr>{cells}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def pairs(rows: Sequence[tuple[str, str]]) -> str:
    """A table of names and values without a head."""
    lines = "".join(f'<tr><td class="soft">{escape(name)}</td><td>{escape(value)}</td></tr>' for name, value in rows)
    return f"<table><tbody>{lines}</tbody></table>"


def figure(png: bytes, caption: str) -> str:
    """A picture inside the page."""
    data = base64.b64encode(png).decode("ascii")
    text = escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"><figcaption>{text}</figcaption></figure>'


def folded(name: str, text: str) -> str:
    """Text that is shown when it is asked for."""
    return f"<details><summary>{escape(name)}</summary><pre>{escape(text)}</pre></details>"


def _cell(tag: str, text: str, to_right: bool) -> str:
    kind = ' class="n"' if to_right else ""
    return f"<{tag}{kind}>{escape(text)}</{tag}>"


def _is_number(text: str) -> bool:
    try:
        float(text.split(" ", maxsplit=1)[0].replace(",", ""))
    except ValueError:
        return False
    return True
