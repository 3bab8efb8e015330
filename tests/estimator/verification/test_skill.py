"""Scores by the hour, kept for thirty days."""

import numpy as np
import pytest

from estimator.verification.skill import HOURS, Scores, empty_book, noted, scores

NOTE = (4.0, 1.0, 1.0, 2.0, 9.0, 16.0)


def test_a_window_has_the_means_of_what_was_noted_in_it():
    book = empty_book(2)
    for hour, values in ((100, NOTE), (100, (0.0, 0.5, 0.0, 1.0, 1.0, 4.0)), (90, (100.0, 9.0, 0.0, 9.0, 9.0, 9.0))):
        book = noted(book, hour, 1, values)
    last = scores(Scores, book, until=100, window=5)
    assert last.forecasts.tolist() == [0, 2]
    assert np.isnan(last.rmse[0])
    assert last.rmse[1] == pytest.approx(np.sqrt(2.0))
    assert (last.crps[1], last.coverage[1], last.width[1]) == (0.75, 0.5, 1.5)
    assert last.persistence_rmse[1] == pytest.approx(np.sqrt(5.0))
    assert last.arx_rmse[1] == pytest.approx(np.sqrt(10.0))
    assert scores(Scores, book, until=100, window=11).forecasts[1] == 3


def test_an_hour_takes_the_place_of_the_one_thirty_days_before():
    book = noted(empty_book(1), 5, 0, NOTE)
    assert scores(Scores, noted(book, 5 + HOURS, 0, NOTE), until=5 + HOURS, window=HOURS).forecasts[0] == 1
    assert scores(Scores, book, until=5, window=1).forecasts[0] == 1, "what is passed in is not changed"
