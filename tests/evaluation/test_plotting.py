"""Plots of what the library returns, and the page that a notebook shows of a model."""

import base64
import re

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import mmt
from mmt.texture.model.json_form import model_json

mpl.use("agg")


@pytest.fixture(scope="module")
def drawn():
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=6.0, seed=1)
    session = mmt.RecordedSession(frames, annotations=truth)
    history = mmt.build_model(frames)
    directed = mmt.build_model(frames, mmt.ModellingSettings(inputs="anisotropic"))
    return {
        "session": session,
        "history": history,
        "model": history.model_at(6.0),
        "directed": directed.model_at(6.0),
        "evaluation": mmt.evaluate_session(session),
    }


def shown(what):
    """The axes on which it is plotted, which are those that are given."""
    figure, axes = plt.subplots()
    assert what.plot(ax=axes) is axes
    figure.canvas.draw()
    plt.close(figure)
    return axes


@pytest.mark.parametrize("name", ["session", "history", "model", "directed", "evaluation"])
def test_what_the_library_returns_is_plotted_on_axes_with_units(drawn, name):
    axes = shown(drawn[name])
    assert "(" in axes.get_xlabel()
    assert axes.get_ylabel()
    own = drawn[name].plot()
    assert own is not axes
    plt.close(own.figure)


def test_a_session_shows_its_largest_and_least_sample_when_they_were(drawn):
    frames = np.delete(drawn["session"].frames, slice(500, 3500))
    normal = frames["acceleration_m_s2"][:, 2].astype(float)
    normal -= normal.mean()
    (area,) = shown(mmt.RecordedSession(frames)).collections
    times_s, heights = area.get_paths()[0].vertices.T
    for extreme in ("argmin", "argmax"):
        drawn_at, at = getattr(heights, extreme)(), getattr(normal, extreme)()
        assert heights[drawn_at] == pytest.approx(normal[at])
        assert times_s[drawn_at] == pytest.approx(1e-9 * frames["time_ns"][at], abs=0.01)


@pytest.mark.parametrize("name", ["model", "directed"])
def test_a_model_shows_its_samples_where_they_are(drawn, name):
    samples, axes = drawn[name].samples, shown(drawn[name])
    assert axes.get_xlabel().startswith("speed (mm/s)")
    _, points = axes.collections
    np.testing.assert_allclose(
        points.get_offsets(), np.column_stack([samples.speed_mm_s, samples.force_n])
    )


def test_a_notebook_shows_the_page_that_plays_a_model(drawn):
    element = drawn["model"]._repr_html_()
    found = re.search(r'src="data:text/html;base64,([^"]+)"', element)
    page = base64.b64decode(found[1]).decode()
    assert model_json(drawn["model"], "model").replace("<", "\\u003c") in page


@pytest.mark.parametrize(
    "bound", ["texture.model.json_form.MOST_ROWS", "web.texture_page.MOST_BYTES"]
)
def test_a_notebook_shows_a_model_that_is_too_large_for_a_page_by_its_text(
    drawn, monkeypatch, bound
):
    monkeypatch.setattr(f"mmt.{bound}", 1)
    assert drawn["model"]._repr_html_() is None


def test_what_has_nothing_to_plot_says_so(drawn):
    frames = drawn["session"].frames[["sequence", "time_ns", "force_n"]]
    with pytest.raises(mmt.InputError, match="no acceleration"):
        mmt.RecordedSession(frames).plot()
