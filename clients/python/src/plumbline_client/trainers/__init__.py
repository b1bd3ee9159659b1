"""Rewards in the shapes of the frameworks that train models: TRL, verl, lm-eval's harness.

OpenRLHF and NeMo Gym call the service itself. A failure of the service is never a reward.
"""
