"""Forward and inverse kinematics of bodies."""
