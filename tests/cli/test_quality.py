"""How good the fits of the measured materials are, by compress and compare."""

import pytest
from measured import WEAVE, WOOL, compressed, measured

BARS = {
    WOOL: {"nsvd": 12.75, "k3": 12.2, "k1": 10.8},
    WEAVE: {"nsvd": 6.40, "k3": 6.35, "k1": 5.75},
}


@pytest.mark.parametrize("name", BARS, ids=["wool", "weave"])
def test_measured_materials_are_fitted_well(name, nacre_json, tmp_path_factory):
    dataset = measured(name, tmp_path_factory)
    models = {setting: compressed(name, setting, tmp_path_factory) for setting in BARS[name]}
    said = {setting: nacre_json("compare", dataset, model) for setting, model in models.items()}
    snr = {setting: measures["snr_db"] for setting, measures in said.items()}
    for setting, bar in BARS[name].items():
        assert snr[setting] >= bar
        assert snr[setting] == pytest.approx(
            nacre_json("info", models[setting])["snr_db"], abs=1e-3
        )
    assert snr["k1"] < snr["k3"]
    assert snr["k3"] > snr["nsvd"] - 0.6
    sizes = {setting: model.stat().st_size for setting, model in models.items()}
    assert max(sizes["k3"], sizes["k1"]) <= 1.12 * sizes["nsvd"]
    info = nacre_json("info", models["nsvd"])
    assert info["ratio"] > 250
