"""preshape: plans and runs grasp procedures for two arms with torque-sensing hands."""

__version__ = "0.1.0"
