"""Progress over steps whose number is not known in advance."""

from addon.models.steps import Steps


def test_the_bar_only_goes_forward_and_ends_full():
    seen = []
    steps = Steps(lambda fraction, message: seen.append((fraction, message)) or True)
    for left in (4, 3, 3, 3, 1):  # two more came than were expected
        step = steps.step(left)
        for fraction in (0.0, 0.5, 1.0):
            assert step(fraction, f"{left} left")
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert abs(fractions[-1] - 1.0) < 1e-12
    assert seen[1] == (0.125, "4 left")


def test_a_no_is_passed_on():
    assert not Steps(lambda fraction, message: False).step(2)(0.0, "")
    assert Steps(None).step(2)(0.0, "")
