"""The curves of a history hold its data."""

import numpy as np
import pytest

import shellkit as sk


def lines(figure):
    return {line.get_label(): line for line in figure.axes[0].get_lines()}


def test_curves_are_the_columns(result):
    figure = sk.plot_history(result)
    drawn = lines(figure)
    assert set(drawn) == {"loss", "VertexDistance", "after a refused design", "best: 0.2"}
    np.testing.assert_array_equal(drawn["loss"].get_xydata(), [[0, 1.0], [1, 0.5], [2, 0.25]])
    np.testing.assert_array_equal(drawn["VertexDistance"].get_ydata(), [0.4, 0.2, np.nan])  # zero has no logarithm
    np.testing.assert_array_equal(drawn["after a refused design"].get_xydata(), [[1, 0.5]])
    np.testing.assert_array_equal(drawn["best: 0.2"].get_xydata(), [[3, 0.2]])
    assert figure.axes[0].get_yscale() == "log"


def test_against_time(result):
    drawn = lines(sk.plot_history(result, against="seconds"))
    np.testing.assert_array_equal(drawn["loss"].get_xdata(), [1.0, 3.0, 5.0])


def test_any_columns_do_and_a_term_that_is_the_loss_is_left_out():
    drawn = lines(sk.plot_history({"loss": [3.0, 2.0], "Volume": [3.0, 2.0], "gradient_norm": [1.0, 1.0]}))
    assert set(drawn) == {"loss"}


def test_what_a_least_squares_solver_records_of_itself_is_no_term():
    columns = {"loss": [3.0, 2.0], "Volume": [1.0, 2.0], "control": [1.0, 0.1], "products": [5.0, 7.0]}
    assert set(lines(sk.plot_history(columns))) == {"loss", "Volume"}


def test_it_is_written_and_shows_in_a_notebook(result, tmp_path):
    figure = sk.plot_history(result, title="a fit", save=tmp_path / "history.png")
    assert (tmp_path / "history.png").read_bytes().startswith(b"\x89PNG")
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_what_is_wrong_is_said(result):
    with pytest.raises(ValueError, match="no steps"):
        sk.plot_history(sk.History())
    with pytest.raises(ValueError, match="the columns are: VertexDistance"):
        sk.plot_history({"VertexDistance": [1.0]})
    with pytest.raises(ValueError, match="'hours'; there are: step, loss"):
        sk.plot_history(result, against="hours")
