"""Processor seconds of the tests, with those of their child processes and of collection; a plugin of pytest.

CPU_BY_TEST=cpu.jsonl PYTHONPATH=tests/benchmarks/structure python -m pytest -p cpu_by_test [-n 2 --dist worksteal]
python tests/benchmarks/structure/cpu_by_test.py cpu.jsonl [NUMBER]

The first adds a line for each test to the file; the second prints sums by folder, and the longest tests and files.
Wall time tells little where processors are shared. Of a test that is killed with its children nothing is known.
"""

import collections
import json
import os
import sys
import time
from collections.abc import Iterator

import pytest

COLLECTION = "collection"


def seconds() -> float:
    """Processor time of this process and of the children that it has waited for."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def note(name: str, spent: float) -> None:
    with open(os.environ["CPU_BY_TEST"], "a", encoding="utf-8") as file:
        file.write(json.dumps([name, round(spent, 4)]) + "\n")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection() -> Iterator[None]:
    result = yield
    note(COLLECTION, seconds())  # from the start of the process
    return result


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Of its fixtures too, which the first test that needs them pays."""
    began = seconds()
    try:
        return (yield)
    finally:
        note(item.nodeid, seconds() - began)


def main(path: str, number: str = "25") -> None:
    with open(path, encoding="utf-8") as file:
        lines = [json.loads(line) for line in file]
    tables: dict[str, collections.Counter[str]] = {k: collections.Counter() for k in ("folder", "file", "test")}
    for name, spent in lines:
        file_name = name.partition("::")[0]
        for key, part in (("folder", "/".join(file_name.split("/")[:2])), ("file", file_name), ("test", name)):
            tables[key][part] += spent
    print(f"{sum(spent for _, spent in lines):.1f} s, {sum(n != COLLECTION for n, _ in lines)} tests")
    for key, table in tables.items():
        print(f"\nby {key}")
        for name, spent in table.most_common(int(number)):
            print(f"{spent:8.2f}  {name}")


if __name__ == "__main__":
    main(*sys.argv[1:])
