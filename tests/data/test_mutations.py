"""Changed files of every reader: a content or a sentence; `tests/benchmarks/attack` does the same by the 100,000."""

import random
import warnings

import pytest

from gonio.models.errors import GonioError
from support.marks import thorough
from support.mutations import mutate, read_anything
from support.seed_files import valid_files


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    return valid_files(tmp_path_factory.mktemp("valid"))


def test_the_files_themselves_are_read(valid):
    for path in valid:
        assert read_anything(path)


@pytest.mark.parametrize("seed", [0, *thorough(1, 2, 3)])
def test_a_changed_file_is_read_or_refused_in_a_sentence(valid, tmp_path, seed):
    rng, refused = random.Random(seed), 0
    for path in valid * 5:
        target = tmp_path / f"x{path.suffix}"
        mutate(path, target, rng)
        before = target.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # numbers that overflow: what comes of them is judged
            try:
                read_anything(target)
            except GonioError as error:
                refused += 1
                assert "\n" not in str(error) and len(str(error)) < 400
        assert target.read_bytes() == before
    assert refused > len(valid)
