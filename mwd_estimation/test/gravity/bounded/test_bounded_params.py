"""Settings of the bounded filter reach the kernel under their own names."""

import dataclasses

from mwd_estimation.gravity.bounded import params as settings

# Settings whose constant has another name; `gap` is the clock's.
OTHERWISE = {
    "bias_sigma": "K_BIAS_0", "scale_sigma": "K_SCALE_0", "lever_sigma": "K_LEVER_0", "down_sigma": "K_DOWN_0",
    "calibration_sigma": "K_FLOOR", "sigma_reserve": "K_RESERVE", "turning_sigma": "K_ASKEW",
}  # fmt: skip


def test_each_setting_is_the_constant_of_its_name():
    base = settings.constants(settings.Params())
    assert len(base) == settings.SETTINGS
    seen = set()
    for field in dataclasses.fields(settings.Params):
        if field.name == "gap":
            continue
        default = getattr(settings.Params(), field.name)
        changed = settings.constants(dataclasses.replace(settings.Params(), **{field.name: 1.5 * default + 0.1}))
        index = getattr(settings, OTHERWISE.get(field.name, f"K_{field.name.upper()}"))
        assert [k for k in range(settings.SETTINGS) if changed[k] != base[k]] == [index], field.name
        seen.add(index)
    assert seen == set(range(settings.SETTINGS))
