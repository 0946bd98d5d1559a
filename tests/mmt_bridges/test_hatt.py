"""Models of the Penn Haptic Texture Toolkit come in and go out; bad files are explained."""

import numpy as np
import pytest
from library_samples import directed, model, write_hatt
from scipy.signal import freqz

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt_bridges.hatt.file import parse_hatt
from mmt_bridges.hatt.models import export_hatt, import_hatt

FREQUENCIES = np.linspace(5.0, 495.0, 99)


def test_a_file_of_poles_comes_in_as_it_is(tmp_path):
    imported = import_hatt(write_hatt(tmp_path / "cork.xml"))
    assert (imported.material, imported.friction, imported.zeros) == ("Cork", 0.31, 0)
    assert imported.spectrum_error_db == 0.0
    assert imported.same_triangles is not None
    found = imported.model
    assert (found.rate_hz, found.order, len(found.samples)) == (10_000.0, 4, 4)
    assert (found.space.maximum_speed_mm_s, found.space.maximum_force_n) == (800.0, 8.0)
    lsf, variance = found.at(800.0, 8.0)
    np.testing.assert_allclose(lsf[0], [0.4, 1.0, 2.0, 2.5])
    assert variance[0] == 0.25
    assert found.at(0.0, 4.0)[1][0] == 0.0
    middle = found.at(400.0, 4.0)[1][0]
    assert 0.0 <= middle < 0.25
    path = write_hatt(tmp_path / "m.xml", change=("<SpeedUnits>mm/s", "<SpeedUnits>m/s"))
    assert import_hatt(path).model.space.maximum_speed_mm_s == 800_000.0


def test_a_file_with_zeros_comes_in_with_more_poles(tmp_path):
    imported = import_hatt(write_hatt(tmp_path / "cork.xml", zeros=True))
    assert imported.zeros == 2
    assert 0.0 < imported.spectrum_error_db <= 0.1
    found = imported.model.spectrum(800.0, 8.0, frequencies_hz=FREQUENCIES)
    poles = np.append(1.0, lsf_to_ar(np.array([0.4, 1.0, 2.0, 2.5])))
    _, response = freqz([2.0, -0.8, 0.6], poles, FREQUENCIES, fs=1000.0)
    wanted = 0.25 * np.abs(response) ** 2 * 2.0 / 1000.0
    assert np.abs(10 * np.log10(found / wanted)).max() < 0.5


def test_a_model_that_went_out_comes_back_the_same(tmp_path):
    before = model()
    path = tmp_path / "out.xml"
    path.write_bytes(export_hatt(before, "cork & <bark>", friction=0.2))
    imported = import_hatt(path)
    assert imported.material == "cork & <bark>"
    assert imported.friction == 0.2
    assert imported.same_triangles == 1.0
    generator = np.random.default_rng(3)
    speed, force = generator.uniform(0, 300, 200), generator.uniform(0, 3, 200)
    for one, other in zip(before.at(speed, force), imported.model.at(speed, force), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_a_field_goes_out_with_its_variance_at_the_vertices(tmp_path):
    before = type(model())(model().samples)
    path = tmp_path / "out.xml"
    path.write_bytes(export_hatt(before, "cork"))
    at = before.vertices[:, :2].T * np.array([[300.0], [3.0]])
    np.testing.assert_allclose(import_hatt(path).model.at(*at)[1], before.at(*at)[1], rtol=1e-9)
    with pytest.raises(InputError, match="heading"):
        export_hatt(directed(), "cork")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<modelSet>", "<models>"), "no XML"),
        (("<numMod>4", "<numMod>5"), "4 are there"),
        (("<value>3</value></tri>", "<value>9</value></tri>"), "allowed is 1 to 4"),
        (("<var>0.25", "<var>-1"), "model 4: <var> is negative"),
        (("<var>0.25", "<var>nan"), "model 4: <var> is 'nan'"),
        (("<speedMod>800.0", "<speedMod>fast"), "<speedMod> is 'fast'"),
        (("<value>0.400000</value>", ""), "model 2 has 4 numbers"),
        (("<value>0.400000</value>", "<value>3.2</value>"), "ascend"),
        (("<maxSpeed>800", "<maxSpeed>0"), "<maxSpeed> is 0"),
        (("<SampleRate>10000</SampleRate>", ""), "no <SampleRate>"),
        (("<ForceUnits>N", "<ForceUnits>lbf"), "'lbf', known are"),
        (("<forceMod>0.0</forceMod>", ""), "model 1 has no <forceMod>"),
        (('<?xml version="1.0"?>', "<!DOCTYPE x [<!ENTITY a 'b'>]>"), "document type"),
    ],
)
def test_a_bad_file_is_explained(tmp_path, change, message):
    path = write_hatt(tmp_path / "bad.xml", change=change)
    with pytest.raises(InputError, match=message) as raised:
        import_hatt(path)
    assert "bad.xml" in str(raised.value)


def test_another_xml_file_and_none_are_refused(tmp_path):
    for content, message in ((b"<html/>", "no file of HaTT"), (b"<modelSet/>", "holds no <model>")):
        with pytest.raises(InputError, match=message):
            parse_hatt(content)
    with pytest.raises(InputError, match="No such file"):
        import_hatt(tmp_path / "none.xml")
