"""Many tables at once: each result is what a fit alone gives, and a table that cannot be fitted costs no other."""

from concurrent.futures import Executor, Future

import cloudpickle
import numpy as np
import pytest

import gonio
from gonio.data import layouts
from gonio.data.hdf5.writer import write_table
from gonio.data.table import whole_table_of_values
from gonio.models.errors import GonioError
from gonio.models.evaluation import evaluate
from gonio.models.expression.builder import build

MODEL = "lambert + ggx"


def table_of(rho, alpha, step=10.0, noise=0.01):
    polar = np.radians(np.arange(0, 86, step))
    layout = layouts.isotropic(polar, polar, np.radians(np.arange(0, 360, 30.0)))
    f = np.asarray(evaluate(build(f"lambert(rho={rho}) + 0.4*ggx(alpha={alpha})"), *layout.directions()))
    noisy = f * (1 + noise * np.random.default_rng(int(100 * rho)).standard_normal(f.shape))
    return whole_table_of_values(layout, noisy.reshape(layout.shape))


def test_each_is_what_a_fit_alone_gives(tmp_path):
    tables = [table_of(0.1, 0.3), table_of(0.5, 0.1), table_of(0.3, 0.2, 17.0)]
    write_table(tmp_path / "second.h5", tables[1])
    heard = []
    found = gonio.fit_many(
        [tables[0], tmp_path / "second.h5", lambda: tables[2]], MODEL, starts=2, workers=2,
        done=lambda k, r: heard.append((k, r)),
    )  # fmt: skip
    for result, table in zip(found, tables, strict=True):
        alone = gonio.fit(table, MODEL, starts=2)
        assert result.expression == alone.expression and result.cost == alone.cost and result.converged
    assert sorted(k for k, _ in heard) == [0, 1, 2] and all(found[k] is r for k, r in heard)


def test_a_refused_table_costs_no_other(tmp_path):
    table = table_of(0.1, 0.3)
    dark = whole_table_of_values(table.layout, np.full(table.layout.shape, np.nan))
    found = gonio.fit_many([dark, tmp_path / "absent.h5", table], MODEL, starts=0)
    assert "no valid reading" in str(found[0]) and "does not exist" in str(found[1]) and found[2].converged
    for bad in ([], [table]):
        with pytest.raises(GonioError, match=r"at least one|1 or more"):
            gonio.fit_many(bad, MODEL, workers=0)


class AnotherProcess(Executor):
    """What goes to another process and back, as Dask sends it."""

    def submit(self, function, *arguments):
        sent = cloudpickle.loads(cloudpickle.dumps((function, arguments)))
        future = Future()
        future.set_result(cloudpickle.loads(cloudpickle.dumps(sent[0](*sent[1]))))
        return future


def test_an_executor_gives_what_a_fit_alone_gives(tmp_path):
    table = table_of(0.1, 0.3, 17.0)
    write_table(tmp_path / "t.h5", table)
    fits = gonio.fit_many([table, tmp_path / "t.h5", lambda: table], "lambert", executor=AnotherProcess(), starts=0)
    alone = gonio.fit(table, "lambert", starts=0)
    assert all(fit.expression == alone.expression and fit.cost == alone.cost for fit in fits)
    with pytest.raises(GonioError, match="workers are those of the executor"):
        gonio.fit_many([table], "lambert", executor=AnotherProcess(), workers=2)
