"""Recipes: what is wrong ends in one sentence, before any work; keys change with what changes a result, and no else."""

import pytest

import gonio
from gonio.campaigns.recipe import read_recipe
from gonio.campaigns.tasks import tasks_of

HEAD = "gonio_campaign = 1\n"
MEASURE = HEAD + '[[measure]]\nmaterials = ["gold"]\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (HEAD, "it has no subjects"),
        (MEASURE + "seed = 3", "measure 1: unknown key 'seed'; did you mean 'seeds'"),
        (HEAD + '[[measure]]\nmaterials = ["golt"]', "measure 1: Unknown material 'golt'; did you mean 'gold'"),
        (HEAD + "[[measure]]\nseeds = 1", "measure 1: it has no materials"),
        (HEAD + "[[measure]]\nmaterials = []", "materials is empty"),
        (HEAD + 'tables = ["*.h5"]\nfit = "lambert"', r"no file is named \*.h5"),
        (HEAD + 'tables = ["a.h5"]\nfit = "lambert"', "a.h5 does not exist"),
        (HEAD + 'tables = ["r.toml"]', "nothing is done with its tables"),
        (MEASURE + 'seeds = "3:1"', "seeds is '3:1'"),
        (MEASURE + 'seeds = "0:99999999999"', "at most 200,000 seeds"),
        (MEASURE + 'seeds = "1-5"', "a range such as"),
        (MEASURE + "seeds = [-1]", "seeds has -1"),
        (MEASURE + "seeds = true", "an entry of seeds is bool"),
        (MEASURE + "photons = [0]", "photons has 0"),
        (MEASURE + 'photons = "1e6"', "an entry of photons is str"),
        (MEASURE + 'scans = "isotropc"', "scan .*isotropc.* is unknown"),
        (MEASURE + 'scans = "rgl"', "rgl is no scan of a campaign"),
        (MEASURE + "scans = [{step = 7.77, theta_max = 95}]", "theta_max"),
        (MEASURE + "scans = [{steps = 5}]", "unknown key 'steps'; did you mean 'step'"),
        (MEASURE + "instruments = [{axis_sped = 3}]", "unknown key 'axis_sped'; did you mean 'axis_speed'"),
        (MEASURE + 'instruments = "lab.toml"', "lab.toml does not exist"),
        (MEASURE + 'fit = "lambrt"', "did you mean 'lambert'"),
        (MEASURE + 'check = ["table"]', "check has 'table'; did you mean 'tables'"),
        (MEASURE + 'reduce = "low_sun_cra"', "did you mean 'low_sun_car'"),
        (MEASURE + "report = 1", "report is int"),
        (
            HEAD + "fit_options = {stars = 3}\n" + MEASURE[len(HEAD) :],
            "fit_options: unknown key 'stars'; did you mean 'starts'",
        ),
        (HEAD + 'fit_options = {loss = "sigm"}\n' + MEASURE[len(HEAD) :], "Unknown loss 'sigm'; did you mean 'sigma'"),
        (HEAD + "check_options = {level = 3}\n" + MEASURE[len(HEAD) :], "the level is 3"),
        (MEASURE + 'photons = [1, 2, 3]\nseeds = "0:100000"', "300,000 tasks; give at most 200,000"),
        ("measure = 3", "it has no integer gonio_campaign"),
        (HEAD + "measure = [3]", "measure 1 is int"),
    ],
)
def test_what_is_wrong_ends_in_one_sentence(tmp_path, text, sentence):
    path = tmp_path / "r.toml"
    path.write_text(text)
    with pytest.raises(gonio.GonioError, match=sentence) as caught:
        read_recipe(path)
    assert "r.toml: " in str(caught.value) or "r.toml is " in str(caught.value)
    assert "\n" not in str(caught.value)


def keys(**changes):
    block = {"materials": ["lambert(rho=0.3)"], "scans": [{"step": 30}], "photons": 1e6, "seeds": 3}
    block |= {k: v for k, v in changes.items() if k in ("materials", "scans", "photons", "seeds", "instruments")}
    rest = {"fit": "lambert", "check": True} | {k: v for k, v in changes.items() if k not in block}
    return {task.kind: task.key for task in tasks_of(read_recipe(rest | {"measure": [block]}))}


def test_keys_are_those_of_a_campaign_of_old():
    """They change with the format and the version alone: else what was computed would be computed again."""
    assert keys() == keys(name="other", instruments=[{}]) == keys(photons=[1000000], scans=[{"step": 30.0}])


@pytest.mark.parametrize(
    ("changes", "kinds"),
    [
        ({"seeds": 4}, {"measure", "fit", "check"}),
        ({"photons": 1e5}, {"measure", "fit", "check"}),
        ({"materials": ["lambert(rho=0.4)"]}, {"measure", "fit", "check"}),
        ({"scans": [{"step": 15}]}, {"measure", "fit", "check"}),
        ({"instruments": [{"noise": 0.01}]}, {"measure", "fit", "check"}),
        ({"fit": "eon"}, {"fit"}),
        ({"fit_options": {"starts": 3}}, {"fit"}),
        ({"check_options": {"strict": True}}, {"check"}),
    ],
)
def test_a_key_changes_with_what_changes_the_result(changes, kinds):
    before, after = keys(), keys(**changes)
    assert {kind for kind in before if before[kind] != after[kind]} == kinds


def test_a_key_changes_with_the_content_of_a_file_and_not_its_folder(tmp_path):
    def key(folder, text):
        path = tmp_path / folder / "m.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f'gonio_material = 1\nname = "m"\nmodel = "{text}"\n')
        return [t.key for t in tasks_of(read_recipe({"measure": [{"materials": [str(path)]}]}))]

    assert key("a", "lambert(rho=0.3)") == key("b", "lambert(rho=0.3)") != key("b", "lambert(rho=0.31)")


def test_equal_tasks_are_done_once_and_products_are_complete():
    block = {"materials": ["gold", "gold", "grey_card"], "instruments": [{}, {"noise": 0.01}], "seeds": [0, 0, 1]}
    tasks = tasks_of(read_recipe({"fit": ["auto", "auto"], "measure": [block, block]}))
    assert len(tasks) == 2 * 2 * 2 * 2 and len({t.key for t in tasks}) == len(tasks)
    assert {t.labels["model"] for t in tasks if t.kind == "fit"} == {"auto"}


def test_a_pattern_names_files_in_the_folder_of_the_recipe(tmp_path, monkeypatch):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("theta_i,theta_o,f\n0,10,0.3\n")
    (tmp_path / "r.toml").write_text(HEAD + 'tables = ["?.csv"]\ncheck = true')
    monkeypatch.chdir("/")
    assert [c.label for c in read_recipe(tmp_path / "r.toml").tables] == ["a", "b"]
