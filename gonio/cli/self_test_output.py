"""`gonio check --self-test`: the confusion table of the checks themselves."""

import json

from gonio.cli.arguments import write_text
from gonio.text import columns, log, show


def run_self_test(path: str | None, force: bool) -> int:
    """Judges all subjects, prints each verdict, then the confusion table; 0 only if every verdict is right.

    `path`: where all of it goes as JSON; "-" prints that alone, to standard output.
    """
    from gonio.checks.controls.self_test import Judgement, confusion, self_test

    out = log if path == "-" else show
    judged: list[Judgement] = []
    for one in self_test():
        judged.append(one)
        mark = "right" if one.right else "WRONG"
        out(f"{mark}  {one.kind:12}  {one.subject[:64]:64}  expected {one.expected:12}  found {one.outcome}")
    table = confusion(judged)
    wrong = sum(row["wrong"] for row in table.values())
    rows = [(name, str(row["right"]), str(row["wrong"])) for name, row in table.items()]
    out(f"\n{columns(rows, ('subjects: expected', 'right', 'wrong'))}\n")
    out(f"{len(judged)} subjects, {wrong} judged wrongly.")
    if path:
        content = {"gonio_self_test": 1, "confusion": table, "judged": [one.to_dict() for one in judged]}
        write_text(path, json.dumps(content, indent=2, ensure_ascii=False) + "\n", force)
    return 1 if wrong else 0
