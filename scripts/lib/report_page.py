#!/usr/bin/python3
"""Writes index.html and its charts from results.json: the page of speed against error.

usage: report_page.py FOLDER [--readme FILE]
FOLDER holds results.json and the plots that hostgen report made; every picture becomes a part of the page.
--readme FILE   also renew the claims between the markers of this file
"""
import argparse
import html
import json
import os
import re
import shutil
import sys
from pathlib import Path

import report_charts
from report_claims import README_FOLDER, README_PLOTS, advice, at, claims, claims_html, number, with_claims
from report_words import CELLS, HEADINGS, PEERS, SECTIONS, WORDS

QUIET = 0.1  # processors that other programs had on average while an area was measured
LONG = 20  # rows from which on a table is folded away, except on paper
LONGEST = 60  # rows from which on it is folded away on paper, too
ROOT = Path(__file__).resolve().parent.parent.parent

STYLE = """
:root{--text:#1c2127;--dim:#5f6b7a;--line:#d9dee5;--ground:#fff;--card:#f6f8fa;--good:#1a7f37;--bad:#c6262e;--link:#0b62c4}
@media (prefers-color-scheme:dark){:root{--text:#e6eaf0;--dim:#9aa7b6;--line:#39424e;--ground:#14181d;--card:#1d232a;
--good:#57c878;--bad:#ff7b72;--link:#79b8ff}}
body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:1.5rem auto;padding:0 1rem;color:var(--text);
background:var(--ground)}
h1{font-size:1.7rem;margin:.2rem 0}h2{margin-top:2.2rem;border-top:1px solid var(--line);padding-top:1rem}
a{color:var(--link)}.dim,caption,.how{color:var(--dim)}.how{font-size:.85rem}
nav{line-height:2}nav a{display:inline-block;margin-right:.9rem}
.wide{overflow-x:auto}table{border-collapse:collapse;margin:.7rem 0;font-size:.92rem}
caption{text-align:left;padding-bottom:.3rem;font-size:.95em}
th,td{padding:.25rem .7rem;border-bottom:1px solid var(--line);text-align:right;font-variant-numeric:tabular-nums;
vertical-align:top}
th{font-weight:600;background:var(--card)}th:first-child,td:first-child,.words td,.words th{text-align:left}
.bad{color:var(--bad);font-weight:600}.good{color:var(--good)}
summary{cursor:pointer;color:var(--link)}figure{margin:1rem 0;background:#fff;border:1px solid var(--line);border-radius:6px;padding:.5rem}
figure svg,figure img{max-width:100%;height:auto;display:block;margin:auto}figcaption{color:#5f6b7a;font-size:.9rem}
@media screen and (max-width:40rem){.words th:first-child,.words td:first-child{min-width:9rem}
th:first-child,td:first-child{position:sticky;left:0;max-width:10rem}td:first-child{background:var(--ground)}
figure{overflow-x:auto}figure svg{max-width:none;width:48rem}}
@media print{nav{display:none}body{max-width:none;font-size:11px;color:#000;background:#fff}h2{break-after:avoid}
tr,figure{break-inside:avoid}.wide{overflow:visible}table,.how{font-size:8.5px}th,td{padding:.08rem .22rem}
details:not([open])>summary::after{content:": on the screen only, and in results.json"}}
"""


def shown(key, value):
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return " / ".join(shown(key, item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{word(k)} {shown(k, v)}" for k, v in value.items())
    if isinstance(value, str):
        return html.escape(CELLS.get(value, value))
    heading = HEADINGS.get(key, ("", 1))
    if isinstance(heading, tuple) and heading[1] != 1:
        return f"{value * heading[1]:.1f}"
    return number(value)


def word(key):
    """A key of results.json in words, with its unit."""
    heading = HEADINGS.get(key)
    if heading:
        return heading[0] if isinstance(heading, tuple) else heading
    for ending, unit in (("_per_s", "/s"), ("_us", "µs"), ("_mm", "mm"), ("_ms", "ms"), ("_deg", "°"), ("_px", "px"),
                         ("_mb", "MB"), ("_nm", "N m"), ("_s", "s"), ("_n", "N")):
        if key.endswith(ending):
            return f"{key[:-len(ending)].replace('_', ' ')}, {unit}"
    return key.replace("_", " ")


def table(rows, columns, caption=""):
    """Rows are dictionaries; a column that no row has is left out."""
    rows = [row for row in rows if row.get("touches") != 0]  # an empty band
    columns = [c for c in columns if any(row.get(c) is not None for row in rows)]
    if not rows or not columns:
        return ""
    head = "".join(f"<th scope=col>{html.escape(word(c))}</th>" for c in columns)
    body = "".join("<tr>" + "".join(f"<td>{shown(c, row.get(c))}</td>" for c in columns) + "</tr>\n" for row in rows)
    is_long = len(rows) > LONG
    title = f"<caption>{caption}</caption>" if caption and not is_long else ""
    text = f"<div class=wide><table>{title}<thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>\n"
    if not is_long:
        return text
    paper = "" if len(rows) > LONGEST else " class=paper"
    return f"<details{paper}><summary>{caption or 'All'} ({len(rows)} rows)</summary>\n{text}</details>\n"


def figures(values, prefix=""):
    """Single figures of an area, in words; tables are shown by themselves."""
    rows = []
    for key, value in values.items():
        if key == "why" or (isinstance(value, list) and value and isinstance(value[0], dict)):
            continue
        name = f"{prefix}{word(key)}"
        if isinstance(value, dict):
            rows += figures(value, f"{name}: ")
        elif value is not None:
            rows.append(f"<tr><td>{html.escape(name)}</td><td>{shown(key, value)}</td></tr>\n")
    if "why" in values:
        rows.append(f"<tr><td class=dim colspan=2>{html.escape(prefix)}not measured: {html.escape(values['why'])}</td></tr>\n")
    return rows


def picture(folder, name, caption):
    """A plot as a part of the page. Its ids are made its own: several pictures share the document."""
    file = folder / name
    if not file.exists():
        return ""
    svg = re.sub(r"^.*?(?=<svg)", "", file.read_text(), flags=re.S)
    own = Path(name).stem
    svg = re.sub(r"<title>(Gnuplot|\$[^<]*|[^<]*using [^<]*)</title>", "", svg)  # gnuplot's own names of its lines
    svg = re.sub(r"\bid=(['\"])([^'\"]+)\1", rf"id=\1{own}-\2\1", svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{own}-\1)", svg)
    svg = re.sub(r"(xlink:href|href)=(['\"])#([^'\"]+)\2", rf"\1=\2#{own}-\3\2", svg)
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"


def quiet(measured):
    """Times that were taken beside other work are not called quiet."""
    others = measured.get("others")
    if others is None:
        return ""
    if others <= QUIET:
        return ", quiet"
    return f", <b class=bad>other programs took {others:.2g} processors meanwhile: its times are not quiet</b>"


def section(key, results, folder):
    """One section: its words, its figures, its tables and its pictures."""
    entry = SECTIONS[key]
    text = f"<h2 id={key}>{entry['title']}</h2>\n<p>{entry['text']}</p>\n"
    measured = results.get("measured", {}).get(entry["area"])
    if measured:
        text += f"<p class=how><code>{measured['command']}</code>, {measured['date']}, {measured['commit']}{quiet(measured)}"
        text += "".join(f" · <a href=\"{os.path.relpath(ROOT / source, folder)}\">{source}</a>" for source in entry.get("code", [])) + "</p>\n"
    for name, caption in entry.get("pictures", []):
        text += picture(folder, name, caption)
    values = results.get(key)
    if isinstance(values, dict) and entry.get("figures", True):
        rows = figures({name: value for name, value in values.items() if name not in entry.get("tabled", ())})
        text += f"<div class=wide><table class=words><tbody>\n{''.join(rows)}</tbody></table></div>\n" if rows else ""
    for path, columns, caption, order in entry.get("tables", []):
        rows = rows_of(at(results, path) if path else values, entry.get("starts", ()))
        rows = sorted(rows, key=lambda row: -(row.get(order) or 0)) if order else rows
        rows = rows + PEERS.get(path, []) if rows else rows
        text += table(rows, columns, caption)
    return text + "".join(f"<p class=dim>{note}</p>\n" for note in entry.get("notes", []))


def rows_of(values, starts=()):
    """Rows of a table: from a list as they are, or one for each start that they hold figures of; from an object one for each of
    its keys, which becomes the column "method"; objects in a row become columns of their own."""
    if isinstance(values, dict):
        values = [{"method": name, **row} for name, row in values.items() if isinstance(row, dict)]
    if not isinstance(values, list):
        return []
    if starts:
        return [{**row, **row[start], "start": start} for start in starts for row in values if isinstance(row.get(start), dict)]
    return [{**row, **{f"{name}_{key}": part for name, value in row.items() if isinstance(value, dict)
                       for key, part in value.items()}} for row in values]


def page(results, folder):
    machine = html.escape(str(results.get("machine")))
    commits = sorted({how["commit"] for how in results.get("measured", {}).values() if how.get("commit")})
    text = ("<!doctype html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport content=\"width=device-width\">"
            f"<title>Finsight: speed against error</title><style>{STYLE}</style></head><body>\n"
            f"<h1>Finsight: speed against error</h1>\n<p class=dim>{machine}; commit{'s' if len(commits) > 1 else ''} "
            f"{', '.join(commits) or results.get('commit')}; profile {results.get('profile')}. All figures: <a href=results.json>results.json</a>.</p>\n<nav>")
    keys = [key for key in SECTIONS if key in results]
    text += "".join(f"<a href=#{key}>{SECTIONS[key]['title']}</a>" for key in keys) + "</nav>\n"
    text += "<h2 id=claims>Claims</h2>\n" + claims_html(claims(results))
    text += "<p class=dim>" + WORDS["comparable"] + "</p>\n"
    lines = advice(results)
    if lines:
        text += "<h2 id=advice>Which tier should this scene use?</h2>\n<ul>" + "".join(f"<li>{a}</li>" for a in lines) + "</ul>\n"
    unfold = "<script>onbeforeprint = () => document.querySelectorAll('details.paper').forEach((d) => d.open = true)</script>"
    return text + "".join(section(key, results, folder) for key in keys) + unfold + "</body></html>\n"


def renew_readme(readme, results, folder):
    """The claims between README's markers, and beside hostgen's report what they and its plots were made from. What this
    folder has no figures of stays as it stands there, with its own date and commit."""
    kept = readme.parent / README_FOLDER
    file = kept / "claims.json"
    standing = {row["claim"]: row for row in json.loads(file.read_text())["claims"]} if file.exists() else {}
    rows = [standing.get(row["claim"], row) if row["met"] is None else row for row in claims(results)]
    for name, _ in README_PLOTS:
        if (folder / name).exists():
            shutil.copy(folder / name, kept / name)
    plots = [(name, words) for name, words in README_PLOTS if (kept / name).exists()]
    file.write_text(json.dumps({"claims": rows, "plots": plots}, indent=1, ensure_ascii=False) + "\n")
    readme.write_text(with_claims(readme.read_text(), rows, plots))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--readme", type=Path)
    arguments = parser.parse_args()
    results = json.loads((arguments.folder / "results.json").read_text())
    report_charts.draw(results, arguments.folder)
    (arguments.folder / "index.html").write_text(page(results, arguments.folder))
    if arguments.readme:
        renew_readme(arguments.readme, results, arguments.folder)
    print(arguments.folder / "index.html")


if __name__ == "__main__":
    sys.exit(main())
