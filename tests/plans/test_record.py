"""Plan files: read back bit for bit, written whole, refused where anything in them is wrong."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from proof_plans import example_b

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.files import json_value, write_atomically
from floatplan.plans.plan import rebuild
from floatplan.plans.reading import load_record
from floatplan.plans.record import PlanRecord

AWKWARD = [0.1 + 0.2, -0.0, 5e-324, np.nextafter(1e4, 0), 1 / 3, np.nextafter(1, 2), -1e-17, 1e4 / 3]


@pytest.fixture(scope="module")
def record():
    """Example B with its obstacle, made without the planner."""
    return example_b()


class TestRoundTrip:
    def test_is_bit_for_bit(self, record, tmp_path):
        awkward = replace(
            record,
            coefficients=read_only(np.resize(AWKWARD, record.coefficients.shape)),
            torque_peak=read_only(AWKWARD[:2]),
            angular_momentum=AWKWARD[0],
            clearance_min=AWKWARD[4],
            certificate={"verdict": "proved", "orientation_end": AWKWARD[:2]},
        )
        read = load_record(awkward.save(tmp_path / "plan.json"))
        for field in fields(PlanRecord):
            before, after = getattr(awkward, field.name), getattr(read, field.name)
            if isinstance(before, np.ndarray):
                assert (after.tobytes(), after.dtype) == (before.tobytes(), before.dtype), field.name
                assert not after.flags.writeable
            elif field.name == "robot":
                assert after == before
            else:
                assert json.dumps(json_value(after)) == json.dumps(json_value(before)), field.name
        assert read.angular_momentum_bounds == awkward.angular_momentum_bounds

    def test_of_a_plan_gives_the_same_flight(self, record, tmp_path):
        plan = rebuild(record)
        again = fp.load_plan(plan.save(tmp_path / "plan.json"))
        times = np.linspace(0, plan.duration, 7)
        for name in ("orientation", "positions", "torques", "com_position"):
            assert getattr(again.at(times), name).tolist() == getattr(plan.at(times), name).tolist()
        assert again.record.to_dict() == record.to_dict()


class TestWriteWhole:
    def test_leaves_the_old_file_where_writing_fails(self, tmp_path, monkeypatch):
        path = write_atomically(tmp_path / "file", "old")

        def fail(*_):
            raise OSError("disc full")

        monkeypatch.setattr(Path, "replace", fail)
        with pytest.raises(fp.InputError, match="disc full"):
            write_atomically(path, "new")
        assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
        assert path.read_text() == "old"


class TestDamage:
    @pytest.mark.parametrize(
        ("content", "reason"),
        [
            (b"", "is not JSON"),
            (b"{", "is not JSON"),
            (b"\x00\x01\xff\xfe", "is not a text file in UTF-8"),
            (b"[" * 100_000, "is nested too deeply"),
            (b"[1, 2]", "no JSON object"),
            (b'{"angular_momentum": NaN}', "NaN"),
            (b'{"angular_momentum": -Infinity}', "-Infinity"),
        ],
    )
    def test_a_file_that_is_none_is_refused(self, tmp_path, content, reason):
        path = tmp_path / "plan.json"
        path.write_bytes(content)
        with pytest.raises(fp.InputError, match=reason) as caught:
            load_record(path)
        assert caught.value.source == str(path)

    @pytest.mark.parametrize("objective", ["coefficients", "torque", "acceleration"])
    def test_the_shortest_flight_is_written_and_read(self, root, tmp_path, objective):
        """What is planned in a thousandth of a second has numbers larger than any that is asked."""
        asked = fp.load_problem(root / "problems" / "handstand.toml")
        shortest = replace(
            asked,
            start=replace(asked.start, accelerations="free"),
            flight=replace(asked.flight, duration=1e-3, angular_momentum="free"),
            motion=fp.Motion(objective=objective),
        )
        plan = fp.plan(replace(shortest, goal=replace(asked.goal, orientation=50.0, accelerations="free")), prove=True)
        assert plan.ok
        assert max(plan.objective_value, np.abs(plan.problem.initial.accelerations).max()) > 1e8
        assert fp.load_plan(plan.save(tmp_path / "plan.json")).objective_value == plan.objective_value
        assert fp.certify(tmp_path / "plan.json").proved

    def test_a_plan_of_the_highest_degree_is_written_and_read(self, root, tmp_path):
        asked = fp.load_problem(root / "problems" / "gallery" / "solo.toml")
        plan = fp.plan(replace(asked, motion=fp.Motion(15, "torque")))
        assert plan.ok
        powers = plan.duration ** np.arange(plan.coefficients.shape[1])
        assert np.abs(plan.coefficients * powers).max() > 1e8
        assert fp.certify(plan.save(tmp_path / "plan.json")).proved

    def test_no_file_and_a_folder_are_refused(self, tmp_path):
        with pytest.raises(fp.InputError, match="no such file"):
            fp.load_plan(tmp_path / "plan.json")
        with pytest.raises(fp.InputError, match="is a directory"):
            fp.load_plan(tmp_path)


class TestRobotOfAPlan:
    def moved(self, record, folder, text=None):
        """The plan and its URDF in a folder, the URDF nowhere else."""
        urdf = folder / "gymnast.urdf"
        urdf.write_text(text or Path(record.robot.urdf).read_text())
        gone = replace(record, robot=replace(record.robot, urdf="elsewhere/gymnast.urdf"))
        return gone.save(folder / "plan.json")

    def test_lies_beside_the_plan_where_it_is_gone(self, record, tmp_path):
        assert fp.load_plan(self.moved(record, tmp_path)).robot.sha256 == record.robot.sha256

    def test_that_has_changed_is_refused(self, record, tmp_path):
        text = Path(record.robot.urdf).read_text().replace('value="2.5"', 'value="2.6"')
        with pytest.raises(fp.InputError, match="has changed") as caught:
            fp.load_plan(self.moved(record, tmp_path, text))
        assert "sha256" in caught.value.element
