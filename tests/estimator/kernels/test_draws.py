"""Counter-based random numbers: the published generator, its distributions, and streams that never meet."""

import numpy as np
import pytest
from scipy import stats

from estimator.kernels.draws import Draws, Purpose, words

# Known answers of Philox4x32-10 (Salmon et al. 2011, Random123): counter words, key words, result.
ONES = 0xFFFFFFFF
KNOWN = [
    (0, 0, 0, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES << 32) | ONES, (ONES << 32) | ONES, ONES, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
]


@pytest.mark.parametrize(("seed", "step", "word", "expected"), KNOWN)
def test_known_answers(seed, step, word, expected):
    found = words(np.uint64(seed), np.uint64(step), np.uint64(word), np.uint64(0), np.uint64(word))
    assert tuple(map(int, found)) == expected


COUNT = 200_000


def test_normals_are_standard_normal_and_independent():
    draws = Draws(11, 5).normals(Purpose.REJUVENATE, (4, COUNT))
    assert draws.shape == (4, COUNT)
    flat = draws.ravel()
    assert stats.kstest(flat, "norm").pvalue > 1e-3
    # Five standard errors each.
    assert abs(flat.mean()) < 5 / np.sqrt(flat.size)
    assert abs(flat.var() - 1) < 5 * np.sqrt(2 / flat.size)
    assert abs(stats.kurtosis(flat)) < 5 * np.sqrt(24 / flat.size)
    for lag in (1, 2, 511, 512, 513):
        assert abs(np.corrcoef(flat[:-lag], flat[lag:])[0, 1]) < 5 / np.sqrt(flat.size)
    assert np.abs(np.corrcoef(draws) - np.eye(4)).max() < 5 / np.sqrt(COUNT)


def test_uniforms_are_uniform_and_inside_the_open_interval():
    flat = Draws(3, 0).uniforms(Purpose.PRIOR_PARAMETERS, (5, COUNT // 4)).ravel()
    assert stats.kstest(flat, "uniform").pvalue > 1e-3
    assert flat.min() > 0
    assert flat.max() < 1


def test_streams_differ_by_seed_step_purpose_and_forecast():
    streams = [
        Draws(seed, step, forecast=forecast).normals(purpose, (1, 50)).tobytes()
        for seed in (0, 1, 2**40)
        for step in (0, 1, 2**33)
        for forecast in (False, True)
        for purpose in list(Purpose)[:-1]
    ]
    assert len(set(streams)) == len(streams)


@pytest.mark.parametrize("particles", [0, 1, 7, 8, 9, 1000])
@pytest.mark.parametrize("rows", [0, 1, 2, 3, 4, 5, 10])
def test_any_shape_is_filled_and_a_draw_depends_on_its_place_only(rows, particles):
    first = Draws(7, 9).normals(Purpose.WALK, (rows, particles))
    assert first.shape == (rows, particles)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, Draws(7, 9).normals(Purpose.WALK, (12, 1003))[:rows, :particles])
