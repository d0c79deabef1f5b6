"""SafeStage's evaluator: traces in, verdicts out. Never imports MuJoCo."""

__version__ = "0.1.0"
