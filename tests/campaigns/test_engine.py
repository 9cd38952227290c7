"""The loop of a campaign with executors that fail as clusters do."""

import dataclasses
import random
from concurrent.futures import Future

import pytest

from gonio.campaigns.engine import MOST_DEATHS, Run
from gonio.campaigns.perform import Fault, Unfinished
from gonio.campaigns.store import DONE, REFUSED, Record, Store
from gonio.campaigns.tasks import LABELS, Task
from gonio.models.errors import GonioError


class KilledWorker(Exception):
    """What Dask's is called."""


class Cluster:
    """Does tasks without work, in an order of its own; of some the workers die, or the outcome is an error."""

    def __init__(self, window=3, deaths=None, outcomes=None):
        self.window, self.deaths, self.outcomes = window, dict(deaths or {}), outcomes or {}
        self.order, self.messages = [], []

    def submit(self, function, tasks, folder):
        future, outcomes, without = Future(), [], set()
        self.messages.append([task.key for task in tasks])
        for task in tasks:
            if self.deaths.get(task.key, 0) > 0:
                self.deaths[task.key] -= 1
                future.set_exception(KilledWorker())
                return future
            if without.intersection(task.needs):
                without.add(task.key)
                continue
            self.order.append(task.key)
            outcome = self.outcomes.get(task.key, Record(task.key, task.kind, DONE, True, task.labels, {}, seconds=0.1))
            if isinstance(outcome, Exception):
                future.set_exception(outcome)
                return future
            if isinstance(outcome, Record):
                Store_of[folder].write_record(outcome)
            if outcome.__class__ is Fault or outcome.status != DONE:
                without.add(task.key)
            outcomes.append(outcome)
        future.set_result(outcomes)
        return future

    def require_alive(self):
        """It is."""

    def died(self, error):
        return isinstance(error, KilledWorker)


Store_of = {}


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path)
    made.prepare()
    Store_of[str(tmp_path)] = made
    return made


def task(kind, key, needs=(), after=()):
    return Task(kind, key, {}, dict.fromkeys(LABELS) | {"subject": key}, {}, tuple(needs), tuple(after))


def subject(n):
    measure, fit, check = f"m{n}", f"f{n}", f"c{n}"
    return [
        task("measure", measure),
        task("fit", fit, [measure]),
        task("check", check, [fit]),
        task("report", f"r{n}", [measure], [fit]),
    ]


def run(tasks, store, cluster):
    whole = Run(tasks, store, lambda task, record: None)
    whole.keep(False)
    whole.work(cluster)
    return whole.tally


@pytest.mark.parametrize("window", [1, 2, 7])
def test_nothing_is_begun_before_what_it_needs(store, window):
    tasks = [t for n in range(5) for t in subject(n)]
    random.Random(window).shuffle(tasks)
    cluster = Cluster(window)
    tally = run(tasks, store, cluster)
    place = {key: k for k, key in enumerate(cluster.order)}
    assert tally.done.total() == 20 and tally.all_good and len(place) == 20
    assert all(place[need] < place[t.key] for t in tasks for need in (*t.needs, *t.after))


def test_a_task_whose_workers_die_is_handed_out_again_a_few_times(store):
    cluster = Cluster(deaths={"m0": MOST_DEATHS, "m1": MOST_DEATHS + 1})
    tally = run([*subject(0), *subject(1)], store, cluster)
    assert tally.done == {"measure": 1, "fit": 1, "check": 1, "report": 1}
    assert len(tally.faults) == 4 and any("died" in why for why in tally.faults.values())
    assert run([*subject(0), *subject(1)], store, Cluster()).done.total() == 4  # and tried anew in the next run


def test_what_a_refused_table_was_for_is_refused_too(store):
    refusal = Record("f0", "fit", REFUSED, False, {}, {}, "too few readings")
    tally = run(subject(0), store, Cluster(outcomes={"f0": refusal}))
    assert tally.refused == {"fit": 1, "check": 1} and tally.done == {"measure": 1, "report": 1}
    assert "too few readings" in store.record("c0").error and store.record("r0").status == DONE


def test_what_stops_a_campaign_says_that_it_goes_on(store):
    with pytest.raises(GonioError, match=r"no room; what is done is kept: run it again to go on"):
        run([*subject(0), *subject(1)], store, Cluster(1, outcomes={"f0": Unfinished("no room.")}))
    assert store.keys() == {"m0"} and run(subject(0), store, Cluster()).kept == {"measure": 1}


def test_records_of_strangers_are_not_believed(store):
    record = Record("m0", "measure", DONE, True, dict.fromkeys(LABELS), {}, file="tables/m0.h5")
    store.write_record(record)
    assert store.record("m0") is None  # its file is not there
    for text in ("", "[]", "{}", '{"gonio_campaign_record": 2}', '{"gonio_campaign_record": 1, "key": 3}'):
        (store.folder / "records" / "m1.json").write_text(text)
        assert store.record("m1") is None
    store.write_record(dataclasses.replace(record, key="m2", file=None, kind="nothing"))
    assert store.record("m2") is None and list(store.records()) == []


def test_short_tasks_go_many_in_a_message_and_the_last_ones_few(store):
    cluster = Cluster(2)
    assert run([t for n in range(100) for t in subject(n)], store, cluster).done.total() == 400
    sizes = [len(message) for message in cluster.messages]
    assert sizes[0] == 1 and max(sizes) == 10 and sizes[-1] == 1 and len(sizes) < 90  # of .1 s each, one second
    assert all(len(message) == 1 for message in Cluster(2).messages)


@pytest.mark.parametrize("seed", range(5))
def test_every_task_ends_once_whatever_happens_on_the_way(store, seed):
    rng = random.Random(seed)
    tasks = [t for n in range(30) for t in subject(n)]
    some = rng.sample(tasks, 20)
    deaths = {t.key: rng.randint(1, MOST_DEATHS + 1) for t in some[:8]}
    outcomes = {t.key: Fault(t.key, "a fault") for t in some[8:14]}
    outcomes |= {t.key: Record(t.key, t.kind, REFUSED, False, t.labels, {}, "no") for t in some[14:]}
    ended = []
    whole = Run(tasks, store, lambda task, record: ended.append(record.key))
    whole.keep(False)
    whole.work(Cluster(rng.randint(1, 5), deaths, outcomes))
    by_name = {t.name: t.key for t in tasks}
    faults = [by_name[name] for name in whole.tally.faults]
    assert sorted(ended + faults) == sorted(t.key for t in tasks)  # each once
    assert set(ended) == store.keys() and not whole.handed and not whole.ready
    lost = {t.key for t in some[8:14]} | {key for key, times in deaths.items() if times > MOST_DEATHS}
    followers = {f"{kind}{key[1:]}" for key in lost for kind in {"m": "fcr", "f": "c"}.get(key[0], "")}
    assert set(faults) <= lost | followers
