"""Models and HaTT files made for tests, with nothing of any real one."""

import numpy as np

from mmt.texture.autoregression.forms import (
    lsf_to_ar,
    lsf_to_reflection,
    output_power,
    reflection_to_lsf,
)
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.space import ANISOTROPIC, ISOTROPIC


def model(space=ISOTROPIC, *, seed=0, order=8, rate_hz=1000.0):
    generator = np.random.default_rng(seed)
    count = 12
    if space.directed:
        inputs = generator.uniform([-200, -200, 0.3], [200, 200, 2.7], (count, 3))
    else:
        inputs = generator.uniform([20, 0.2], [280, 2.8], (count, 2))
    gaps = generator.dirichlet(np.full(order + 1, 5.0), count)
    lsf = np.cumsum(gaps, axis=1)[:, :order] * np.pi
    variance = generator.uniform(0.1, 1.0, count)
    power = output_power(variance, lsf_to_reflection(lsf))
    samples = TextureSamples(inputs, lsf, variance, power, space)
    return TextureModel(samples, method="published", rate_hz=rate_hz)


def stiff(seed, method="published", scale=1.0):
    """Return a model with poles at the unit circle; each sample's order of them is another."""
    generator = np.random.default_rng(seed)
    poles = np.array([0.9999999, -0.9999999, 0.99, -0.99, 0.9, -0.9, 0.5, 0.1])
    reflection = np.array([generator.permutation(poles) for _ in range(20)])
    variance = scale * generator.uniform(0.0, 5.0, 20)
    samples = TextureSamples.isotropic(
        generator.uniform(10, 300, 20),
        generator.uniform(0.1, 3, 20),
        reflection_to_lsf(reflection),
        variance,
        output_power(variance, reflection),
    )
    return TextureModel(samples, method=method)


def directed(seed=0):
    return model(ANISOTROPIC, seed=seed)


def write_hatt(path, *, zeros=False, change=("", "")):
    """Write four vertices and two triangles in HaTT's schema, as the toolkit would."""
    lsf = np.array(
        [[0.4, 0.9, 1.6, 2.4], [0.5, 1.0, 1.5, 2.2], [0.3, 1.1, 1.9, 2.6], [0.4, 1, 2, 2.5]]
    )
    points = [(0.0, 0.0), (800.0, 0.0), (0.0, 8.0), (800.0, 8.0)]
    lines = [
        '<?xml version="1.0"?>', "<modelSet>", "<material> Cork </material>",
        "<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits>",
        f"<SampleRate>{1000 if zeros else 10000}</SampleRate><mu>0.31</mu>",
        "<numMod>4</numMod><numTri>2</numTri><maxSpeed>800</maxSpeed><maxForce>8</maxForce>",
        "<numARCoeff>5</numARCoeff><numMACoeff>3</numMACoeff>",
        "<speedList><value>0</value><value>800</value></speedList>",
        "<forceList><value>0</value><value>8</value></forceList>",
        "<tri><value>1</value><value>2</value><value>3</value></tri>",
        "<tri><value>2</value><value>4</value><value>3</value></tri>",
    ]  # fmt: skip
    for row, (speed, force) in zip(lsf, points, strict=True):
        ar = "".join(f"<value>{value:.6f}</value>" for value in [1.0, *lsf_to_ar(row)])
        frequencies = "".join(f"<value>{value:.6f}</value>" for value in row)
        lines += ["<model>", f"<ARcoeff>{ar}</ARcoeff>", f"<ARlsf>{frequencies}</ARlsf>"]
        if zeros:
            lines += [
                "<MAcoeff><value>1</value><value>-0.4</value><value>0.3</value></MAcoeff>",
                "<MAlsf><value>1.1</value><value>1.7</value></MAlsf>",
            ]
        variance = 0.0 if speed == 0.0 or force == 0.0 else 0.25
        lines += [f"<var>{variance}</var>", f"<gain>{2 if zeros else 1}</gain>"]
        lines += [f"<speedMod>{speed}</speedMod><forceMod>{force}</forceMod>", "</model>"]
    lines.append("</modelSet>")
    text = "\n".join(lines)
    assert change[0] in text
    path.write_text(text.replace(*change, 1) if change[0] else text)
    return path
