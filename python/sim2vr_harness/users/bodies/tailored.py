"""A body cut to a person: the options of `load_body` that every body shares."""

from collections.abc import Callable
from dataclasses import replace

import mujoco

from sim2vr_harness.users.bodies.mirror import mirror, swapped
from sim2vr_harness.users.bodies.options import BodyOptions
from sim2vr_harness.users.bodies.person import Anatomy, change_joints, resize, strengthen
from sim2vr_harness.users.bodies.rules import Motor
from sim2vr_harness.users.bodies.spec_body import BodyPlan, SpecBody
from sim2vr_harness.users.name_errors import unknown_name


def tailored_body(
    plan: BodyPlan,
    build: Callable[[bool], mujoco.MjSpec],
    options: BodyOptions,
    anatomy: Anatomy,
) -> SpecBody:
    """Makes the body for the person of `options`.

    Args:
        plan: what the body's parts are for, before it is mirrored.
        build: makes a fresh specification of the body as it was measured, with drawn shapes or
            without, devices included.
        options: who the person is, how episodes begin.
        anatomy: who the body was measured on.

    Raises:
        ValueError: a person that the body cannot be, or a posture that it does not have.
    """
    person = options.person
    mirrored = person.handedness is not None and person.handedness != _own_hand(plan)

    def made(appearance: bool) -> mujoco.MjSpec:
        spec = build(appearance)
        resize(spec, person, anatomy)
        strengthen(spec, person.strength)
        change_joints(spec, person.joints)
        if mirrored:
            mirror(spec)
        return spec

    if mirrored:
        plan = replace(
            plan,
            devices=tuple(swapped(name) for name in plan.devices),
            end_effectors=tuple(swapped(name) for name in plan.end_effectors),
        )
    if person.ipd_m is not None:
        plan = replace(plan, ipd_m=person.ipd_m)
    # The body's own way to begin, changed by what `reset` sets; joints left out stay.
    reset = options.reset
    rule = plan.reset_rule
    if reset.posture is not None and reset.posture not in plan.postures:
        raise ValueError(unknown_name("reset.posture", reset.posture, plan.postures))
    named = {} if reset.posture is None else plan.postures[reset.posture]
    if posture := {**named, **reset.angles}:
        # Far from 0 the dependent joints cannot start there: the couplings would yank the arm.
        rule = replace(rule, posture={**rule.posture, **posture}, fit_couplings=True)
    if reset.position_range is not None:
        rule = replace(rule, position_range=reset.position_range)
    if reset.velocity_range is not None:
        rule = replace(rule, velocity_range=reset.velocity_range)
    if reset.activation_range is not None:
        rule = replace(rule, activation_range=reset.activation_range)
    if reset.hold:
        motors = (g.actuators for g in plan.actuator_groups if g.rule == Motor.name)
        rule = replace(rule, held=tuple(name for names in motors for name in names))
    plan = replace(plan, reset_rule=rule)
    return SpecBody(plan, made, options.appearance)


def _own_hand(plan: BodyPlan) -> str:
    """The hand that a body plays with: the right one, if it wears a controller there."""
    only_left = "controller_left" in plan.devices and "controller_right" not in plan.devices
    return "left" if only_left else "right"
