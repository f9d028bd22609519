"""A red square that the right hand touches, with pyopenxr and OpenGL, without a window.

Run: python touch.py [--seed N]   (pip install pyopenxr PyOpenGL numpy; needs an OpenXR runtime that
has XR_MNDX_egl_enable)
"""

from __future__ import annotations

import argparse
import ctypes
import os
import random

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("EGL_PLATFORM", "surfaceless")

import numpy as np
import xr
from OpenGL import EGL, GL

RADIUS_M = 0.08
NEAR_M, FAR_M = 0.05, 100.0
RIGHT = "/user/hand/right"
DEPTH_LAYERS = "XR_KHR_composition_layer_depth"
IMAGE = xr.SwapchainImageOpenGLKHR
STEREO = xr.ViewConfigurationType.PRIMARY_STEREO


def egl_binding() -> xr.GraphicsBindingEGLMNDX:
    """A current OpenGL context without a window, as XrSessionCreateInfo takes it."""
    display = EGL.eglGetDisplay(EGL.EGL_DEFAULT_DISPLAY)
    EGL.eglInitialize(display, None, None)
    EGL.eglBindAPI(EGL.EGL_OPENGL_API)
    config, count = EGL.EGLConfig(), ctypes.c_int()
    wanted = [EGL.EGL_SURFACE_TYPE, 0, EGL.EGL_RENDERABLE_TYPE, EGL.EGL_OPENGL_BIT, EGL.EGL_NONE]
    EGL.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
    context = EGL.eglCreateContext(display, config, EGL.EGL_NO_CONTEXT, [EGL.EGL_NONE])
    EGL.eglMakeCurrent(display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, context)
    address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    return xr.GraphicsBindingEGLMNDX(
        get_proc_address=ctypes.cast(address, xr.PFN_xrEglGetProcAddressMNDX),
        display=display,
        config=config,
        context=context,
    )


class Hand:
    """The right hand: where it is, and its vibration."""

    def __init__(self, instance: xr.Instance, session: xr.Session) -> None:
        self.session = session
        actions = xr.create_action_set(instance, xr.ActionSetCreateInfo("play", "Play", 0))
        self.pose = xr.create_action(
            actions, xr.ActionCreateInfo("hand", xr.ActionType.POSE_INPUT, 0, None, "Hand")
        )
        self.buzz = xr.create_action(
            actions, xr.ActionCreateInfo("buzz", xr.ActionType.VIBRATION_OUTPUT, 0, None, "Buzz")
        )
        ends = ((self.pose, "input/grip/pose"), (self.buzz, "output/haptic"))
        bindings = [
            xr.ActionSuggestedBinding(action, xr.string_to_path(instance, f"{RIGHT}/{end}"))
            for action, end in ends
        ]
        for profile in ("khr/simple_controller", "oculus/touch_controller"):
            suggested = (xr.ActionSuggestedBinding * 2)(*bindings)
            name = xr.string_to_path(instance, f"/interaction_profiles/{profile}")
            xr.suggest_interaction_profile_bindings(
                instance, xr.InteractionProfileSuggestedBinding(name, 2, suggested)
            )
        xr.attach_session_action_sets(session, xr.SessionActionSetsAttachInfo(1, [actions]))
        self.space = xr.create_action_space(session, xr.ActionSpaceCreateInfo(self.pose))
        self.active = xr.ActiveActionSet(actions, xr.NULL_PATH)

    def place(self, stage: xr.Space, time: int) -> np.ndarray | None:
        """Return x y z in m; None: not tracked."""
        xr.sync_actions(self.session, xr.ActionsSyncInfo(1, ctypes.pointer(self.active)))
        found = xr.locate_space(self.space, stage, time)
        if not found.location_flags & xr.SPACE_LOCATION_POSITION_VALID_BIT:
            return None
        return np.array([found.pose.position.x, found.pose.position.y, found.pose.position.z])

    def vibrate(self) -> None:
        """Vibrate for 50 ms."""
        pulse = xr.HapticVibration(duration=50_000_000, frequency=160.0, amplitude=0.6)
        base = ctypes.cast(ctypes.pointer(pulse), ctypes.POINTER(xr.HapticBaseHeader))
        xr.apply_haptic_feedback(self.session, xr.HapticActionInfo(self.buzz), base.contents)


class Eye:
    """One view: swapchains for colour and depth, and a framebuffer for both."""

    def __init__(self, session: xr.Session, width: int, height: int) -> None:
        self.size = width, height
        formats = (GL.GL_SRGB8_ALPHA8, GL.GL_DEPTH_COMPONENT32F)
        uses = (
            xr.SwapchainUsageFlags.COLOR_ATTACHMENT_BIT,
            xr.SwapchainUsageFlags.DEPTH_STENCIL_ATTACHMENT_BIT,
        )
        self.chains = [
            xr.create_swapchain(
                session, xr.SwapchainCreateInfo(0, use, kind, 1, width, height, 1, 1, 1)
            )
            for kind, use in zip(formats, uses, strict=True)
        ]
        self.images = [xr.enumerate_swapchain_images(chain, IMAGE) for chain in self.chains]
        self.framebuffer = GL.glGenFramebuffers(1)
        rect = xr.Rect2Di(xr.Offset2Di(0, 0), xr.Extent2Di(width, height))
        color, depth = (xr.SwapchainSubImage(chain, rect, 0) for chain in self.chains)
        self.color = color
        self.depth = xr.CompositionLayerDepthInfoKHR(depth, 0.0, 1.0, NEAR_M, FAR_M)

    def draw(self, view: xr.View, things: list[tuple[np.ndarray, tuple[float, ...]]]) -> None:
        """Draw squares that face the viewer, the nearest last, each with its depth."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.framebuffer)
        for chain, images, place in zip(
            self.chains, self.images, (GL.GL_COLOR_ATTACHMENT0, GL.GL_DEPTH_ATTACHMENT), strict=True
        ):
            index = xr.acquire_swapchain_image(chain)
            xr.wait_swapchain_image(chain, xr.SwapchainImageWaitInfo(xr.INFINITE_DURATION))
            texture = images[index].image
            GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, place, GL.GL_TEXTURE_2D, texture, 0)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        self.clear((0.25, 0.28, 0.3), 4.0)
        GL.glEnable(GL.GL_SCISSOR_TEST)
        seen = [(self.relative(view, place), color) for place, color in things]
        for (x, y, z), color in sorted(seen, key=lambda one: one[0][2]):
            if -z > NEAR_M and self.scissor(view.fov, x, y, -z):
                self.clear(color, -z)
        GL.glFlush()
        for chain in self.chains:
            xr.release_swapchain_image(chain)

    def clear(self, color: tuple[float, ...], depth_m: float) -> None:
        """Fill what the scissor leaves with a colour and a distance."""
        GL.glClearColor(*color, 1.0)
        GL.glClearDepth((1.0 / NEAR_M - 1.0 / depth_m) / (1.0 / NEAR_M - 1.0 / FAR_M))
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)

    @staticmethod
    def relative(view: xr.View, place: np.ndarray) -> np.ndarray:
        """A place of the stage in the eye's own frame."""
        at, q = view.pose.position, view.pose.orientation
        gap = place - (at.x, at.y, at.z)
        axis = -np.array([q.x, q.y, q.z])
        across = 2.0 * np.cross(axis, gap)
        return gap + q.w * across + np.cross(axis, across)

    def scissor(self, fov: xr.Fovf, x: float, y: float, ahead: float) -> bool:
        """Limit drawing to a square; whether any of it is in view."""
        edges = []
        for middle, low, high, pixels in (
            (x, fov.angle_left, fov.angle_right, self.size[0]),
            (y, fov.angle_down, fov.angle_up, self.size[1]),
        ):
            span = np.tan([low, high])
            part = ((middle + np.array([-RADIUS_M, RADIUS_M])) / ahead - span[0]) / np.ptp(span)
            edges.append(np.clip(np.rint(part * pixels), 0, pixels).astype(int))
        (left, right), (bottom, top) = edges
        GL.glScissor(left, bottom, max(0, right - left), max(0, top - bottom))
        return bool(right > left and top > bottom)


def running(instance: xr.Instance, session: xr.Session, begun: bool) -> bool | None:
    """Handle events; whether the session runs, None: it is over."""
    while True:
        try:
            event = xr.poll_event(instance)
        except xr.EventUnavailable:
            return begun
        if event.type != xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED:
            continue
        changed = ctypes.cast(
            ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged)
        ).contents
        if changed.state == xr.SessionState.READY:
            xr.begin_session(session, xr.SessionBeginInfo(STEREO))
            begun = True
        elif changed.state == xr.SessionState.STOPPING:
            xr.end_session(session)
            return None
        elif changed.state in (xr.SessionState.EXITING, xr.SessionState.LOSS_PENDING):
            return None


def start() -> tuple[xr.Instance, xr.Session, xr.Space, list[Eye]]:
    """Create the session, its stage and an eye per view."""
    extensions = [xr.MNDX_EGL_ENABLE_EXTENSION_NAME, DEPTH_LAYERS]
    about = xr.ApplicationInfo("touch", 1, "", 0, xr.Version(1, 0, 0))
    instance = xr.create_instance(
        xr.InstanceCreateInfo(application_info=about, enabled_extension_names=extensions)
    )
    system = xr.get_system(instance, xr.SystemGetInfo(xr.FormFactor.HEAD_MOUNTED_DISPLAY))
    binding = egl_binding()
    session = xr.create_session(instance, xr.SessionCreateInfo(0, system, binding))
    stage = xr.create_reference_space(
        session, xr.ReferenceSpaceCreateInfo(xr.ReferenceSpaceType.STAGE)
    )
    sizes = xr.enumerate_view_configuration_views(instance, system, STEREO)
    eyes = [
        Eye(session, one.recommended_image_rect_width, one.recommended_image_rect_height)
        for one in sizes
    ]
    GL.glEnable(GL.GL_FRAMEBUFFER_SRGB)
    return instance, session, stage, eyes


def new_target(places: random.Random) -> np.ndarray:
    """Return and print the place of a target, in m."""
    x, y, z = places.uniform(-0.15, 0.3), places.uniform(0.9, 1.25), -places.uniform(0.35, 0.5)
    print(f"target: {x:.3f} {y:.3f} {z:.3f}", flush=True)
    return np.array([x, y, z])


def drawn(
    eyes: list[Eye], views: list[xr.View], things: list[tuple[np.ndarray, tuple[float, ...]]]
) -> list[xr.CompositionLayerProjectionView]:
    """Draw squares for all eyes; return the views of the layer."""
    shown = []
    for eye, view in zip(eyes, views, strict=True):
        eye.draw(view, things)
        shown.append(xr.CompositionLayerProjectionView(view.pose, view.fov, eye.color, eye.depth))
    return shown


def play(seed: int) -> None:
    """Show a target, and another one after each touch."""
    places = random.Random(seed)
    instance, session, stage, eyes = start()
    hand = Hand(instance, session)
    target, touched, begun = None, 0, False
    while (state := running(instance, session, begun)) is not None:
        begun = state
        if not begun:
            continue
        if target is None:
            target = new_target(places)
        frame = xr.wait_frame(session)
        xr.begin_frame(session)
        time = frame.predicted_display_time
        place = hand.place(stage, time)
        hit = place is not None and np.linalg.norm(place - target) < RADIUS_M
        if hit:
            touched += 1
            print(f"touched: {touched}", flush=True)
            hand.vibrate()
        _, views = xr.locate_views(session, xr.ViewLocateInfo(STEREO, time, stage))
        things = [(target, (0.9, 0.02, 0.02))]
        if place is not None:
            things.append((place, (0.02, 0.1, 0.9)))
        layer = xr.CompositionLayerProjection(space=stage, views=drawn(eyes, views, things))
        xr.end_frame(session, xr.FrameEndInfo(time, layers=[ctypes.pointer(layer)]))
        if hit:
            target = None
    xr.destroy_session(session)
    xr.destroy_instance(instance)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the places of the targets")
    play(parser.parse_args().seed)
