"""Card 12 of the validation: Taylor's test in every array that can be trained."""

import pytest

from validation.cards import gradients


@pytest.mark.slow
@pytest.mark.parametrize("directors", ["free", "average"])
@pytest.mark.parametrize("name", sorted(gradients.WHERE))
def test_gradient(name, directors):
    slope, error, tangent = gradients.measure(1, directors=(directors,), names=(name,))
    assert slope.ours > 1.9
    assert error.ours < 1e-6
    assert tangent.ours < 1e-12
