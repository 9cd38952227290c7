"""`gonio check --self-test`: the confusion table of the checks themselves."""

import dataclasses
import json
import sys


def run_self_test(path: str | None, force: bool) -> int:
    """Judges all subjects, prints each as it is judged, then the confusion table; 0 only if every one is right.

    `path`: where all of it goes as JSON; "-" prints that alone, to standard output.
    """
    from gonio.checks.controls.self_test import confusion, self_test
    from gonio.data.files import new_file
    from gonio.text import columns, say, tell

    out = tell if path == "-" else say
    judged = []
    for one in self_test():
        judged.append(one)
        mark = "right" if one.right else "WRONG"
        out(f"{mark}  {one.kind:12}  {one.subject[:64]:64}  expected {one.expected:12}  found {one.found}")
    table = confusion(judged)
    wrong = sum(row["wrong"] for row in table.values())
    rows = [(name, str(row["right"]), str(row["wrong"])) for name, row in table.items()]
    out(f"\n{columns(rows, ('subjects: expected', 'right', 'wrong'))}\n")
    out(f"{len(judged)} subjects, {wrong} judged wrongly.")
    if path:
        told = {"gonio_self_test": 1, "confusion": table, "judged": [dataclasses.asdict(one) for one in judged]}
        text = json.dumps(told, indent=2, ensure_ascii=False) + "\n"
        if path == "-":
            sys.stdout.write(text)
        else:
            with new_file(path, force) as temporary:
                temporary.write_text(text, encoding="utf-8")
    return 1 if wrong else 0
