"""The page's renderer against Python's, by one excitation: the same samples. Under Node."""

import base64
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_samples import model, stiff

from mmt.models import shipped_models
from mmt.rendering.generating import RateConverter
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import TextureModel, TextureSamples, load_model
from mmt.texture.space import ANISOTROPIC, ISOTROPIC
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt.web.texture_page import MODULE

PROGRAM = Path(__file__).with_name("texture_program.mjs")
NODE = shutil.which("node")
RATES_HZ = (44_100, 48_000, 96_000)
CONVERTED = 4000
"""Samples that are converted to these."""
pytestmark = pytest.mark.skipif(NODE is None, reason="Node is not installed")


def asked(request):
    """Return what the module answers."""
    done = subprocess.run(
        [str(NODE), str(PROGRAM), str(MODULE)],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return json.loads(done.stdout)


def coded(values):
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


def decoded(text):
    return np.frombuffer(base64.b64decode(text), dtype="<f8")


def strokes(made, count, seed):
    """Return inputs of strokes to and fro that vary in speed, heading and force, with rests."""
    random = np.random.default_rng(seed)
    time_s = np.arange(count) / made.rate_hz
    size = 200.0 * np.abs(np.sin(0.4 * time_s)) * (np.sin(0.11 * time_s) > -0.9)
    turn = 2.0 * np.sin(0.3 * time_s + random.uniform(0.0, 6.0))
    way = size * np.sin(4.4 * time_s)
    force = np.abs(1.2 + np.sin(2.1 * time_s) + 0.4 * np.sin(9.0 * time_s))
    velocity = [way * np.cos(turn), way * np.sin(turn)]
    return [*velocity, force] if made.space.directed else [np.hypot(*velocity), force]


def error(models, inputs, excitation, renewal):
    """Return the largest difference over the root mean square, at all rates; each is checked."""
    count = len(excitation)
    changes = np.linspace(0, count, len(models) + 1).astype(int).tolist()
    synthesizer, parts = Synthesizer(models[0], seed=9, renewal_samples=renewal), []
    for made, first, last in zip(models, changes, changes[1:], strict=False):
        synthesizer.model = made
        moved = (np.ascontiguousarray(values[first:last]) for values in inputs)
        parts.append(synthesizer.render(*moved, excitation=excitation[first:last]))
    expected = np.concatenate(parts)
    answer = asked(
        {
            "forms": [model_json(made, "made") for made in models],
            "inputs": [coded(values) for values in inputs],
            "excitation": coded(excitation),
            "renewal": renewal,
            "rates": RATES_HZ,
            "converted": CONVERTED,
            "changes": changes,
        }
    )
    assert "refused" not in answer
    pairs = [(answer["samples"], expected)]
    if answer["called"] is not None:
        pairs.append((answer["called"], expected))
    for rate_hz, converted in zip(RATES_HZ, answer["converted"], strict=True):
        pairs.append(
            (converted, RateConverter(models[0].rate_hz, rate_hz).convert(expected[:CONVERTED]))
        )
    rms = float(np.sqrt(np.mean(expected**2)))
    worst = max(float(np.abs(decoded(text) - samples).max()) for text, samples in pairs)
    return worst / rms if rms > 0.0 else worst


@pytest.mark.parametrize("name", shipped_models())
@pytest.mark.parametrize("method", ["field", "published"])
def test_shipped_models_give_the_same_samples_for_a_minute(name, method):
    shipped = load_model(name)
    made = shipped if method == shipped.method else TextureModel(shipped.samples, method=method)
    white = np.random.default_rng(1).standard_normal(60_000)
    renewal = 1 if method == "field" else 10
    assert error([made], strokes(made, 60_000, 2), white, renewal) < 1e-9


@st.composite
def random_models(draw):
    """Models whose filters have reflection coefficients of magnitude up to 0.999."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    space = draw(st.sampled_from([ISOTROPIC, ANISOTROPIC]))
    order, count = draw(st.integers(1, 64)), draw(st.integers(1, 30))
    largest = draw(st.sampled_from([0.5, 0.9, 0.999]))
    reflection = largest * random.uniform(-1.0, 1.0, (count, order)) ** 3
    variance = random.uniform(0.0, 2.0, count)
    low, high = ([-250, -250, 0.1], [250, 250, 3]) if space.directed else ([5, 0.1], [300, 3])
    samples = TextureSamples(
        random.uniform(low, high, (count, len(low))),
        reflection_to_lsf(reflection),
        variance,
        output_power(variance, reflection),
        space,
    )
    rate_hz = draw(st.sampled_from([1000.0, 2500.0, 10_000.0]))
    return TextureModel(
        samples, method=draw(st.sampled_from(["field", "published"])), rate_hz=rate_hz
    )


@settings(max_examples=20)
@given(made=random_models(), renewal=st.sampled_from([1, 3, 20]), seed=st.integers(0, 99))
def test_random_models_give_the_same_samples(made, renewal, seed):
    inputs = strokes(made, 4000, seed)
    random = np.random.default_rng(seed)
    for values in inputs:  # what hands do not do
        values[random.integers(0, 4000, 5)] = [np.nan, np.inf, -np.inf, -1.0, 1e300]
    white = random.standard_normal(4000)
    allowed = max(1e-6, 10.0 * effect_of_last_bits(made, inputs, white, renewal))
    assert error([made], inputs, white, renewal) < allowed


def effect_of_last_bits(made, inputs, white, renewal):
    """Return how far Python's own samples move by changes of the frequencies' last bits.

    At orders above 40 the frequencies of such filters may be 1e-12 apart, and this is 1 or more.
    """

    def rendered(each):
        synthesizer = Synthesizer(each, seed=9, renewal_samples=renewal)
        return synthesizer.render(*inputs, excitation=white)

    lsf, exact, moved = made.samples.lsf, rendered(made), 0.0
    for seed in range(3):
        ways = np.where(np.random.default_rng(seed).random(lsf.shape) < 0.5, -np.inf, np.inf)
        samples = replace(made.samples, lsf=np.nextafter(lsf, ways))
        other = TextureModel(samples, method=made.method, rate_hz=made.rate_hz)
        moved = max(moved, float(np.abs(rendered(other) - exact).max()))
    return moved / max(float(np.sqrt(np.mean(exact**2))), 1e-300)


@pytest.mark.parametrize("method", ["field", "published"])
def test_poles_at_the_unit_circle_and_models_that_grow_give_the_same_samples(method):
    growing = [model(seed=seed, order=order) for seed, order in enumerate((8, 12, 5))]
    white = np.random.default_rng(3).standard_normal(6000)
    assert error(growing, strokes(growing[0], 6000, 4), white, 1) < 1e-9
    poles = stiff(5, method, scale=1e-12)
    assert error([poles], strokes(poles, 6000, 4), white, 1) < 1e-6


def test_a_model_of_ten_kilohertz_gives_the_same_samples():
    made = load_model("oak").at_rate(10_000.0)
    white = np.random.default_rng(1).standard_normal(20_000)
    assert error([made], strokes(made, 20_000, 2), white, 10) < 1e-9


def changed(**changes):
    return json.dumps({**json.loads(model_json(model(), "made")), **changes})


def rows_with(value, column):
    form = json.loads(model_json(model(), "made"))
    rows = decoded(form["rows"]["data"]).reshape(form["rows"]["shape"]).copy()
    rows[3, column] = value
    return changed(rows={**form["rows"], "data": coded(rows)})


def corners(values):
    data = base64.b64encode(np.array(values, dtype="<u2").tobytes()).decode()
    return {"type": "uint16", "shape": [len(values), 3], "data": data}


MOST_CHARACTERS = 4_000_000
HUGE = {"type": "float64", "shape": [2**31, 2**31], "data": ""}
HOSTILE = {
    "no JSON": ("{", "not JSON"),
    "another thing": ("[1]", "format"),
    "nothing": ("null", "format"),
    "a version to come": (changed(version=2), "version is 2, this page reads 1"),
    "an order of ten thousand": (changed(order=10_000), "order must be 1 to 64"),
    "a rate of nothing": (changed(rate_hz=0), "rate_hz must be"),
    "too much of it": (" " * (MOST_CHARACTERS + 1), "characters, allowed are"),
    "a huge shape": (changed(rows=HUGE), "the shape of rows is wrong"),
    "no rows": (changed(rows=None), "it lacks rows"),
    "a level of 1e308": (rows_with(1e308, 2), "a level is not within"),
    "NaN": (rows_with(np.nan, 2), "not finite"),
    "an unstable filter": (rows_with(0.0, 3), "do not ascend"),
    "a corner that is none": (changed(simplices=corners([[0, 1, 9999]])), "do not exist"),
    "a mesh in a circle": (changed(simplices=corners([[0, 1, 2]] * 3)), "three simplices share"),
    "a network of junk": (changed(network={"type": "float64"}), "the shape of network is wrong"),
    "a prototype": ('{"__proto__": {"format": "mmt-texture"}, "version": 1}', "format"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_no_model_is_refused_with_a_sentence(kind):
    form, sentence = HOSTILE[kind]
    request = {"forms": [form], "inputs": [], "excitation": "", "renewal": 1, "rates": []}
    refused = asked({**request, "changes": [0, 0]})["refused"]
    assert sentence in refused
    assert refused.startswith("This is no texture model that can be played: ")
    assert len(refused) < 200
