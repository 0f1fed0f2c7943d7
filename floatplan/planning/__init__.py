"""The search: constraints, transcription to a nonlinear program, SQP, planner."""
