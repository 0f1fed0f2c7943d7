"""No false proof: plans tampered with at random, judged by an evaluation that shares no code with the proof."""

import numpy as np
from proof_judge import Judge
from proof_mutations import base_plans, mutate
from proof_records import certify_record

MUTATIONS = 36  # scripts/mutations.py makes 10 000
INSTANTS = 3001


def test_no_false_proof_and_hardly_a_false_alarm(tmp_path):
    rng = np.random.default_rng(20260729)
    bases = base_plans()[:3]
    assert all(certify_record(record).proved for record in bases)
    judge = Judge(INSTANTS)
    outcomes = {"valid": [], "invalid": [], "unclear": []}
    for number in range(MUTATIONS):
        case = mutate(rng, bases[number % len(bases)], tmp_path)
        truth = judge(case.robot, case.record)
        outcomes[truth].append((case.kind, certify_record(case.record).verdict))
    assert [case for case in outcomes["invalid"] if case[1] == "proved"] == []
    alarms = [case for case in outcomes["valid"] if case[1] != "proved"]
    assert len(alarms) <= 0.01 * len(outcomes["valid"])
    assert len(outcomes["invalid"]) > MUTATIONS / 4
    assert len(outcomes["valid"]) > MUTATIONS / 6
