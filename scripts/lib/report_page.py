#!/usr/bin/python3
"""Writes index.html and its charts from results.json: the page of speed against error.

usage: report_page.py FOLDER [--readme FILE]
FOLDER holds results.json and the plots that hostgen report made; every picture becomes a part of the page.
--readme FILE   also renew the claims between the markers of this file
"""
import argparse
import html
import json
import re
import sys
from pathlib import Path

import report_charts
from report_charts import at
from report_words import HEADINGS, SECTIONS, WORDS

QUIET_LOAD = 1.0  # average number of other programs that wanted a processor in the minute before
ROOT = Path(__file__).resolve().parent.parent.parent
BEGIN, END = "<!-- BEGIN GENERATED claims by `scripts/report --readme` -->", "<!-- END GENERATED claims -->"

STYLE = """
:root{--text:#1c2127;--dim:#5f6b7a;--line:#d9dee5;--ground:#fff;--card:#f6f8fa;--good:#1a7f37;--bad:#c6262e;--link:#0b62c4}
@media (prefers-color-scheme:dark){:root{--text:#e6eaf0;--dim:#9aa7b6;--line:#39424e;--ground:#14181d;--card:#1d232a;
--good:#57c878;--bad:#ff7b72;--link:#79b8ff}}
body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:1.5rem auto;padding:0 1rem;color:var(--text);
background:var(--ground)}
h1{font-size:1.7rem;margin:.2rem 0}h2{margin-top:2.2rem;border-top:1px solid var(--line);padding-top:1rem}
a{color:var(--link)}.dim,caption,.how{color:var(--dim)}.how{font-size:.85rem}
nav{line-height:2}nav a{display:inline-block;margin-right:.9rem;white-space:nowrap}
.wide{overflow-x:auto}table{border-collapse:collapse;margin:.7rem 0;font-size:.92rem}
caption{text-align:left;padding-bottom:.3rem}
th,td{padding:.25rem .7rem;border-bottom:1px solid var(--line);text-align:right;font-variant-numeric:tabular-nums;
vertical-align:top}
th{font-weight:600;background:var(--card)}th:first-child,td:first-child,.words td,.words th{text-align:left}
.bad{color:var(--bad);font-weight:600}.good{color:var(--good)}
figure{margin:1rem 0;background:#fff;border:1px solid var(--line);border-radius:6px;padding:.5rem}
figure svg,figure img{max-width:100%;height:auto;display:block;margin:auto}figcaption{color:#5f6b7a;font-size:.9rem}
@media print{nav{display:none}body{max-width:none;font-size:11px;color:#000;background:#fff}h2{break-after:avoid}
table,figure{break-inside:avoid}}
"""


def number(value, places=3):
    if value == 0:
        return "0"
    if not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
    if abs(value) >= 10 ** places:
        return f"{value:,.0f}"
    text = f"{value:.{places}g}"
    return f"{float(text):g}" if "e" in text and abs(value) > 1e-4 else text


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
        return html.escape(value)
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


def table(rows, columns, caption="", first_words=1):
    """Rows are dictionaries; a column that no row has is left out."""
    columns = [c for c in columns if any(row.get(c) is not None for row in rows)]
    if not rows or not columns:
        return ""
    head = "".join(f"<th scope=col>{html.escape(word(c))}</th>" for c in columns)
    body = "".join("<tr>" + "".join(f"<td>{shown(c, row.get(c))}</td>" for c in columns) + "</tr>\n" for row in rows)
    caption = f"<caption>{caption}</caption>" if caption else ""
    return f"<div class=wide><table>{caption}<thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>\n"


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
    svg = re.sub(r"\bid=(['\"])([^'\"]+)\1", rf"id=\1{own}-\2\1", svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{own}-\1)", svg)
    svg = re.sub(r"(xlink:href|href)=(['\"])#([^'\"]+)\2", rf"\1=\2#{own}-\3\2", svg)
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>\n"


def value_of(results, wanted):
    """Of a claim: a number, a path of results.json, or a function of all of it."""
    if wanted is None or isinstance(wanted, (int, float)):
        return wanted
    return wanted(results) if callable(wanted) else at(results, wanted)


def claims(results):
    """What is claimed beside what others reach: rows of words, with whether the aim is met."""
    rows = []
    for claim in report_charts.CLAIMS:
        ours = value_of(results, claim["ours"])
        peer = value_of(results, claim["peer"])
        measured = results.get("measured", {}).get(claim["area"], {})
        row = {"claim": claim["claim"], "ours": "not measured", "peer": "–", "ratio": "–", "met": None,
               "peer_is": claim["peer_is"], "command": measured.get("command", f"scripts/report {claim['area']}"),
               "date": measured.get("date", "–"), "commit": measured.get("commit", "–")}
        if ours is not None:
            row["ours"] = f"{number(float(ours))} {claim['unit']}".strip()
            row["met"] = ours <= claim["aim"] if claim["less_is_better"] else ours >= claim["aim"]
        if peer is not None:
            row["peer"] = f"{number(float(peer))} {claim['unit']}".strip()
            if ours:
                row["ratio"] = f"{number(float(peer / ours if claim['less_is_better'] else ours / peer), 2)} ×"
        row["aim"] = f"{'≤' if claim['less_is_better'] else '≥'} {number(float(claim['aim']))} {claim['unit']}".strip()
        rows.append(row)
    return rows


def claims_html(rows):
    body = ""
    for row in rows:
        mark = "" if row["met"] is None else " class=good" if row["met"] else " class=bad"
        short = "" if row["met"] is not False else " – falls short"
        body += (f"<tr><td>{row['claim']}</td><td>{row['peer_is']}</td><td>{row['peer']}</td><td{mark}>{row['ours']}{short}</td>"
                 f"<td>{row['aim']}</td><td>{row['ratio']}</td><td class=how><code>{row['command']}</code><br>{row['date']}, "
                 f"{row['commit']}</td></tr>\n")
    return ("<div class=wide><table class=words><thead><tr><th>claim</th><th>beside</th><th>theirs</th><th>ours</th><th>aim</th>"
            f"<th>ratio</th><th>made again by</th></tr></thead><tbody>\n{body}</tbody></table></div>\n")


def claims_markdown(rows):
    """The same for README, without dates and commits."""
    text = "| claim | beside | theirs | ours | aim | command |\n|---|---|---|---|---|---|\n"
    for row in rows:
        ours = f"**{row['ours']} (falls short)**" if row["met"] is False else row["ours"]
        text += f"| {row['claim']} | {row['peer_is']} | {row['peer']} | {ours} | {row['aim']} | `{row['command']}` |\n"
    return text


def with_claims(readme, rows):
    before, marker, rest = readme.partition(BEGIN)
    if not marker or END not in rest:
        raise SystemExit(f"report_page: the file has no lines {BEGIN} and {END}")
    return before + BEGIN + "\n" + claims_markdown(rows) + END + rest.partition(END)[2]


def load_of(measured):
    """Times that were taken beside other work are not called quiet."""
    load = measured.get("load")
    if load is None:
        return ""
    return f", load {load}" + (": <b class=bad>other work was running, so its times are not quiet</b>" if load > QUIET_LOAD else "")


def section(key, results, folder):
    """One section: its words, its figures, its tables and its pictures."""
    entry = SECTIONS[key]
    text = f"<h2 id={key}>{entry['title']}</h2>\n<p>{entry['text']}</p>\n"
    measured = results.get("measured", {}).get(entry["area"])
    if measured:
        text += f"<p class=how><code>{measured['command']}</code>, {measured['date']}, {measured['commit']}{load_of(measured)}"
        text += "".join(f" · <a href=\"{ROOT / source}\">{source}</a>" for source in entry.get("code", [])) + "</p>\n"
    for name, caption in entry.get("pictures", []):
        text += picture(folder, name, caption)
    values = results.get(key)
    if isinstance(values, dict) and entry.get("figures", True):
        rows = figures(values)
        text += f"<div class=wide><table class=words><tbody>\n{''.join(rows)}</tbody></table></div>\n" if rows else ""
    for path, columns, caption, order in entry.get("tables", []):
        rows = at(results, path) if path else values
        if "starts" in entry and isinstance(rows, list):  # each row holds one object of figures per start
            rows = [{**row, **row[start], "start": start} for start in entry["starts"] for row in rows
                    if isinstance(row.get(start), dict)]
        if isinstance(rows, list):
            rows = sorted(rows, key=lambda row: -(row.get(order) or 0)) if order else rows
            text += table(rows, columns, caption)
    return text


def page(results, folder):
    machine = html.escape(str(results.get("machine")))
    text = ("<!doctype html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport content=\"width=device-width\">"
            f"<title>Finsight: speed against error</title><style>{STYLE}</style></head><body>\n"
            f"<h1>Finsight: speed against error</h1>\n<p class=dim>{machine}; commit {results.get('commit')}; profile "
            f"{results.get('profile')}. All figures: <a href=results.json>results.json</a>.</p>\n<nav>")
    keys = [key for key in SECTIONS if key in results]
    text += "".join(f"<a href=#{key}>{SECTIONS[key]['title']}</a>" for key in keys) + "</nav>\n"
    text += "<h2 id=claims>Claims</h2>\n" + claims_html(claims(results))
    text += "<p class=dim>" + WORDS["comparable"] + "</p>\n"
    advice = report_charts.advice(results)
    if advice:
        text += "<h2 id=advice>Which tier should this scene use?</h2>\n<ul>" + "".join(f"<li>{a}</li>" for a in advice) + "</ul>\n"
    return text + "".join(section(key, results, folder) for key in keys) + "</body></html>\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--readme", type=Path)
    arguments = parser.parse_args()
    results = json.loads((arguments.folder / "results.json").read_text())
    report_charts.draw(results, arguments.folder)
    (arguments.folder / "index.html").write_text(page(results, arguments.folder))
    if arguments.readme:
        arguments.readme.write_text(with_claims(arguments.readme.read_text(), claims(results)))
    print(arguments.folder / "index.html")


if __name__ == "__main__":
    sys.exit(main())
