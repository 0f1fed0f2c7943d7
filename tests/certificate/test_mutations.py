"""No false proof: plans tampered with at random, judged by an evaluation that shares no code with the proof."""

import numpy as np
from proof_judge import Judge
from proof_mutations import base_plans, mutate
from proof_records import assert_no_false_proof, certify_record

MUTATIONS = 18  # scripts/mutations.py makes 10 000
INSTANTS = 3001


def test_no_false_proof_and_hardly_a_false_alarm(tmp_path):
    rng = np.random.default_rng(20260729)
    bases = base_plans()[:3]
    assert all(certify_record(record).proved for record in bases)
    judge = Judge(INSTANTS)
    drawn = (mutate(rng, bases[number % len(bases)], tmp_path) for number in range(MUTATIONS))
    assert_no_false_proof(drawn, lambda case: judge(case.robot, case.record))
