"""Names of before go on working, with a warning that says the new one."""

import pytest

import shellkit as sk


def test_a_name_of_before_does_the_same_and_warns():
    with pytest.warns(DeprecationWarning, match=r"shellkit\.direct_solver is now shellkit\.linear_solver"):
        found = sk.direct_solver(name="superlu")
    assert type(found) is type(sk.linear_solver("superlu"))


def test_errors_are_those_of_the_new_name():
    with (
        pytest.warns(DeprecationWarning, match=r"shellkit\.direct_solver is now"),
        pytest.raises(ValueError, match="there is no solver 'none'"),
    ):
        sk.direct_solver("none")
    assert sk.trace.__wrapped__ is sk.continue_path
