"""What a row of the table of limits may be about, and what may be said of each motor."""

import numpy as np
import pytest
from places import URDF

import floatplan as fp
from floatplan.problem import resolution
from floatplan.tables import LIMIT_TABLE, LimitRow

GYMNAST = URDF / "gymnast.urdf"


@pytest.mark.parametrize(("of", "known"), [("motors", "motor_torques"), ("base", "orientation_rate")])
def test_a_limit_of_motors_or_the_base_is_of_one_quantity(of, known):
    assert any((row.of, row.quantity) == (of, known) for row in LIMIT_TABLE.values())
    with pytest.raises(ValueError, match=f"^a limit of {of} is of {known}, not of accelerations$"):
        LimitRow("acceleration", "accelerations", "rad/s^2", "Accelerations", of)


class TestANumberForEachMotor:
    """Of rates and accelerations it is known, by the ratios; of other quantities where nothing follows."""

    coupled = fp.Robot.from_urdf(GYMNAST, joints=["q1"], coupled={"q2": fp.Coupling("q1", 2.0)})

    @pytest.fixture(autouse=True)
    def limits_of_joint_torques(self, monkeypatch):
        row = LimitRow("acceleration", "torques", "N m", "Torques", "joints")
        monkeypatch.setattr(resolution, "JOINT_LIMITS", (LIMIT_TABLE["velocity"], row))

    @pytest.mark.parametrize("given", [3.0, {"q1": 3.0}])
    def test_it_is_refused_where_joints_follow_others(self, given):
        with pytest.raises(fp.InputError, match="is not known of each motor") as refused:
            resolution.joint_limits(self.coupled, fp.Limits(acceleration=given))
        assert refused.value.element == "limits.acceleration"
        assert refused.value.advice == "give a list, a number for each planned joint"

    def test_rates_go_by_the_ratios(self):
        found = resolution.joint_limits(self.coupled, fp.Limits(velocity=3.0))
        np.testing.assert_array_equal(found["velocity"], [1.5])
