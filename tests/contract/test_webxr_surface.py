"""Every interface, member and required error of WebXR that a page can see, and what we do about it.

The tables follow the WebXR Device API, the Gamepads Module and the Layers Module; what belongs to
those and is not in them is not covered, and a page does not find even its name.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import frame_time_ns
from sim2vr_harness.client.devices import INPUT_COUNT
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page, page_with

pytestmark = NEEDS_BROWSER

# Interface: what it inherits | attributes | methods with required arguments | handlers.
COVERED = """
XRSystem: EventTarget | | isSessionSupported:1 requestSession:1 offerSession:2 supportsSession:1 |
  devicechange sessiongranted
XRSession: EventTarget | visibilityState frameRate supportedFrameRates renderState inputSources
  enabledFeatures isSystemKeyboardSupported environmentBlendMode interactionMode |
  updateRenderState:0 updateTargetFrameRate:1 requestReferenceSpace:1 requestAnimationFrame:1
  cancelAnimationFrame:1 end:0 addEventListener:1 | end inputsourceschange select selectstart
  selectend squeeze squeezestart squeezeend visibilitychange frameratechange
XRRenderState: | depthNear depthFar inlineVerticalFieldOfView baseLayer | |
XRFrame: | session predictedDisplayTime | getPose:2 getViewerPose:1 |
XRSpace: EventTarget | | |
XRReferenceSpace: XRSpace | | getOffsetReferenceSpace:1 | reset
XRBoundedReferenceSpace: XRReferenceSpace | boundsGeometry | |
XRView: | eye projectionMatrix transform recommendedViewportScale | requestViewportScale:1 |
XRViewport: | x y width height | |
XRRigidTransform: | position orientation matrix inverse | |
XRPose: | transform linearVelocity angularVelocity emulatedPosition | |
XRViewerPose: XRPose | views | |
XRInputSource: | handedness targetRayMode targetRaySpace gripSpace gamepad profiles skipRendering
  | |
XRInputSourceArray: | length | entries:0 keys:0 values:0 forEach:1 |
XRLayer: EventTarget | | |
XRWebGLLayer: XRLayer | antialias ignoreDepthValues framebuffer framebufferWidth framebufferHeight
  fixedFoveation | getViewport:1 |
XRSessionEvent: Event | session | |
XRInputSourceEvent: Event | frame inputSource | |
XRInputSourcesChangeEvent: Event | session added removed | |
XRReferenceSpaceEvent: Event | referenceSpace transform | |
"""

# Layers, hands, hit tests, AR, tracked sources, WebGPU, windows and files.
NOT_COVERED = """
XRCompositionLayer XRProjectionLayer XRQuadLayer XRCylinderLayer XREquirectLayer XRCubeLayer
XRSubImage XRWebGLSubImage XRWebGLBinding XRMediaBinding XRLayerEvent XRRenderState.layers XRHand
XRJointSpace XRJointPose XRInputSource.hand XRFrame.getJointPose XRFrame.fillJointRadii
XRFrame.fillPoses XRRay XRHitTestSource XRHitTestResult XRTransientInputHitTestSource
XRTransientInputHitTestResult XRSession.requestHitTestSource XRFrame.getHitTestResults
XRSession.requestHitTestSourceForTransientInput XRFrame.getHitTestResultsForTransientInput XRAnchor
XRAnchorSet XRPlane XRPlaneSet XRMesh XRMeshSet XRLightProbe XRLightEstimate XRDepthInformation
XRCPUDepthInformation XRWebGLDepthInformation XRCamera XRDOMOverlayState XRSession.requestLightProbe
XRSession.domOverlayState XRSession.depthUsage XRFrame.createAnchor XRFrame.getDepthInformation
XRFrame.getLightEstimate XRFrame.detectedPlanes XRFrame.trackedAnchors XRView.camera
XRView.isFirstPersonObserver XRSession.trackedSources GPU GPUDevice GPUAdapter Navigator.gpu
XRGPUBinding SharedWorker WebSocketStream showSaveFilePicker showOpenFilePicker showDirectoryPicker
"""

GAMEPAD = {
    "Gamepad": "id index connected timestamp mapping axes buttons vibrationActuator "
    "hapticActuators",
    "GamepadButton": "pressed touched value",
    "GamepadHapticActuator": "pulse playEffect reset",
}

# What a page does, and what it throws or is refused with. `lost` has no WebGL context any more,
# `plain` was not made for WebXR; `other` is an inline session, `foreign` its viewer space; `late` a
# frame that is over.
ERRORS = {
    "TypeError": """
        new XRSession(); new XRFrame(); new XRInputSourceArray(); new
        XRBoundedReferenceSpace(); XRRigidTransform(); new XRRigidTransform({ w: 2 }); new
        XRRigidTransform({ x: NaN }); new XRRigidTransform({}, { x: Infinity }); new
        XRRigidTransform({ x: 'one' }); new XRSessionEvent('end', {}); new
        XRSessionEvent('end', { session: {} }); new XRInputSourceEvent('select', {
        inputSource: source }); new XRInputSourcesChangeEvent('x', { session, added: [1],
        removed: [] }); new XRReferenceSpaceEvent('reset', { referenceSpace: space,
        transform: 1 }); navigator.xr.isSessionSupported('vr');
        navigator.xr.requestSession('vr'); navigator.xr.requestSession('inline', 5);
        navigator.xr.requestSession('inline', { requiredFeatures: 'local' });
        session.requestReferenceSpace('moon'); session.requestAnimationFrame(5);
        session.updateRenderState(5); session.updateRenderState({ depthNear: NaN });
        session.updateRenderState({ depthFar: Infinity }); session.updateRenderState({
        baseLayer: {} }); session.updateTargetFrameRate(11); frame.getPose({}, space);
        frame.getPose(space, null); frame.getViewerPose(source.gripSpace);
        space.getOffsetReferenceSpace({}); new XRWebGLLayer(session, {}); new
        XRWebGLLayer({}, gl); XRWebGLLayer.getNativeFramebufferScaleFactor();
        layer.getViewport({}); XRSession.prototype.renderState;
        XRRigidTransform.prototype.matrix; XRSession.prototype.end.call({});
        XRSystem.prototype.isSessionSupported.call(session, 'inline');
        Reflect.get(Navigator.prototype, 'xr', {}); Gamepad.prototype.axes""",
    "InvalidStateError": """
        new XRRigidTransform({}, { x: 0, y: 0, z: 0, w: 0 });
        navigator.xr.requestSession('immersive-vr'); session.updateRenderState({
        inlineVerticalFieldOfView: 1 }); other.updateRenderState({ baseLayer: layer });
        late.getPose(space, space); late.getViewerPose(space);
        selecting.getViewerPose(space); frame.getPose(space, foreign);
        frame.getViewerPose(foreign); layer.getViewport(lateView); new XRWebGLLayer(session,
        plain); new XRWebGLLayer(session, lost); lost.makeXRCompatible(); new
        XRWebGLLayer(gone, gl); gone.end(); gone.updateRenderState();
        gone.requestReferenceSpace('viewer'); other.updateTargetFrameRate(60)""",
    "NotSupportedError": """
        navigator.xr.requestSession('inline', { requiredFeatures: ['hand-tracking'] });
        session.requestReferenceSpace('unbounded'); session.updateRenderState({ layers:
        [layer] })""",
}

# What holds in a frame of a session.
RULES = """
        String(session) === '[object XRSession]' && String(frame) === '[object XRFrame]';
        session.inputSources === session.inputSources && session.inputSources instanceof
        XRInputSourceArray; session.inputSources.length === 2 &&
        [...session.inputSources].length === 2; session.inputSources[0].handedness ===
        'left' && session.inputSources[2] === undefined; session.renderState.baseLayer ===
        layer && session.renderState.inlineVerticalFieldOfView === null;
        other.renderState.inlineVerticalFieldOfView === Math.PI / 2 &&
        other.renderState.baseLayer === null; ['viewer', 'local', 'local-floor',
        'bounded-floor'].every((one) => session.enabledFeatures.includes(one));
        other.enabledFeatures.join() === 'viewer' && other.frameRate === null;
        session.interactionMode === 'world-space' && other.interactionMode ===
        'screen-space'; (session.onselect = late.getPose, session.onselect === late.getPose)
        && !(session.onselect = null); frame.session === session &&
        frame.predictedDisplayTime === performance.now(); frame.getPose(space, space)
        instanceof XRPose && !(frame.getPose(space, space) instanceof XRViewerPose);
        pose.views.map((view) => view.eye).join() === 'left,right' &&
        pose.views[0].transform instanceof XRRigidTransform;
        pose.views[0].recommendedViewportScale === null &&
        pose.views[0].requestViewportScale(0.5) === undefined;
        layer.getViewport(pose.views[1]) instanceof XRViewport &&
        layer.getViewport(pose.views[1]).x === 120; layer.framebuffer instanceof
        WebGLFramebuffer && layer.framebufferWidth === 240 && layer.framebufferHeight ===
        80; new XRRigidTransform({ x: 1 }).matrix[12] === 1 && new
        XRRigidTransform().position.w === 1; new XRRigidTransform(null, null).orientation.w
        === 1 && new XRRigidTransform({}, { w: 3 }).orientation.w === 1;
        Math.abs(turn.inverse.position.y - 1) < 1e-9 && Math.abs(turn.inverse.position.x) <
        1e-9; Math.abs(frame.getPose(space.getOffsetReferenceSpace(turn),
        space).transform.position.x - 1) < 1e-6; floor instanceof XRBoundedReferenceSpace &&
        Object.isFrozen(floor.boundsGeometry) && floor.boundsGeometry.length === 4;
        floor.getOffsetReferenceSpace(new XRRigidTransform({ x: 1 })).boundsGeometry[0].x
        === floor.boundsGeometry[0].x - 1; source.targetRayMode === 'tracked-pointer' &&
        Object.isFrozen(source.profiles) && source.profiles.length === 3;
        Object.isFrozen(source.gamepad.axes) && source.gamepad.axes.length === 4 &&
        source.gamepad.buttons.length === 7; new XRSessionEvent('end', { session, bubbles:
        true }).bubbles && event instanceof XRSessionEvent; Object.isFrozen(change.added) &&
        change.added.length === 2 && change.removed.length === 0 && change.session ===
        session; session.requestAnimationFrame(() => {}) > 0 &&
        gone.requestAnimationFrame(() => {}) === 0; cancelled === 0 && selects ===
        'selectstart select selectend' && ended === 'later'"""

PAGE = (PAGES / "surface.js").read_text()

LISTED = """(() => {
  const found = {};
  for (const name of Object.getOwnPropertyNames(window)) {
    if (!/^XR/.test(name)) continue;
    const { prototype } = window[name];
    const parent = Object.getPrototypeOf(prototype);
    const members = [];
    for (const [key, member] of Object.entries(Object.getOwnPropertyDescriptors(prototype))) {
      if (key === 'constructor') continue;
      const kind = member.get ? 'get' : member.value.length;
      members.push(`${kind} ${key} ${member.enumerable} ${Boolean(member.set)}`);
    }
    found[name] = [parent === Object.prototype ? '' : parent.constructor.name, members];
  }
  return found;
})()"""


def expected() -> dict[str, list[Any]]:
    """What :data:`LISTED` has to find."""
    found: dict[str, list[Any]] = {}
    for row in re.split(r"\n(?=XR)", COVERED.strip()):
        name, _, rest = row.partition(":")
        parent, attributes, methods, handlers = (
            part.strip() for part in f"{rest} |||".split("|")[:4]
        )
        members = [
            f"get {one} true {'true' if one == 'fixedFoveation' else 'false'}"
            for one in attributes.split()
        ]
        for method, count in (one.split(":") for one in methods.split()):
            members.append(f"{count} {method} true false")
        members += [f"get on{one} true true" for one in handlers.split()]
        found[name] = [parent, sorted(members)]
    return found


def texts(words: str) -> list[str]:
    """The statements of a table."""
    return [" ".join(one.split()) for one in words.split(";") if one.strip()]


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a page found of each table."""
    tries = [one for words in ERRORS.values() for one in texts(words)]
    script = f"const ERRORS = {json.dumps(tries)}, RULES = {json.dumps(texts(RULES))};\n{PAGE}"
    page = page_with(tmp_path_factory.mktemp("surface"), script)
    with open_page(page, eyes=2, width=120, height=80) as app:
        app.reset(1, hands(0))
        for step in range(1, 10):
            inputs = np.zeros(INPUT_COUNT)
            inputs[0] = step in (2, 3)
            app.step(frame_time_ns(step, 20), replace(hands(step), right_inputs=inputs))
        evaluate = app._page._evaluate
        gone = NOT_COVERED.split()
        return {
            "notes": app.notes,
            "found": evaluate("app.found"),
            "listed": evaluate(LISTED),
            "present": evaluate(
                f"{json.dumps(gone)}.filter((one) => {{ const [owner, member] = one.split('.');"
                "return member ? member in window[owner].prototype : owner in window; })"
            ),
            "gamepad": evaluate(
                f"Object.entries({json.dumps(GAMEPAD)}).flatMap(([name, members]) => "
                "members.split(' ')"
                ".filter((one) => !(one in window[name].prototype)))"
            ),
        }


def test_interfaces_members_errors_and_rules_are_those_of_the_specification(
    answers: dict[str, Any],
) -> None:
    listed = {name: [parent, sorted(rest)] for name, (parent, rest) in answers["listed"].items()}
    assert listed == expected()
    assert (answers["gamepad"], answers["present"]) == ([], [])
    wanted = {one: name for name, words in ERRORS.items() for one in texts(words)}
    assert dict(answers["found"]["errors"]) == wanted
    assert [one for one in answers["found"]["rules"] if one[1] is not True] == []


FAILING = (PAGES / "offline.js").read_text()


def test_connections_fail_as_without_a_network(tmp_path: Path) -> None:
    with open_page(page_with(tmp_path, FAILING)) as app:
        app.reset(1, hands(0))
        assert app._page._evaluate("app.log") == [
            "true 0 wss://server.example/ws 1 3",
            "InvalidStateError TypeError TypeError",
            "SyntaxError SyntaxError",
            "InvalidAccessError",
            "true TypeError",
            "have-local-offer new",
            "socket error 3",
            "close 1006 false []",
            "stream 0",
            "2",
            "own 2",
            "0",
        ]
        assert app._page._evaluate("app.transport") == "WebTransportError"


@pytest.mark.parametrize(("chosen", "drawn"), [({}, 0), ({"window_frames": "run"}, 4)])
def test_the_window_has_no_frames_in_vr_unless_they_are_chosen(
    tmp_path: Path, chosen: dict[str, str], drawn: int
) -> None:
    values = {"drawn": "app.drawn - app.atEntry"}
    with open_page(page_with(tmp_path, FAILING), values=values, options=chosen) as app:
        app.reset(1, hands(0))
        for step in range(1, 5):
            reply = app.step(frame_time_ns(step, 20), hands(step))
        assert reply.values == {"drawn": drawn}


def test_a_page_that_ended_its_session_enters_again(tmp_path: Path) -> None:
    script = """import { Boxes, button } from './boxes.js';
    const boxes = new Boxes();
    const app = window.app = { entered: 0, ended: 0, after: 0 };
    const enter = async () => {
      await boxes.enter(() => { if (app.ended) app.after += 1; });
      app.entered += 1;
      boxes.session.onend = () => { app.ended += 1; };
      if (app.entered === 1) setTimeout(() => boxes.session.end().then(enter), 500);
    };
    button('Enter VR', enter);"""
    values = {name: f"app.{name}" for name in ("entered", "ended", "after")}
    with open_page(page_with(tmp_path, script), values=values) as app:
        app.reset(1, hands(0))
        for step in range(1, 21):
            reply = app.step(frame_time_ns(step, 20), hands(step))
    assert (reply.values["entered"], reply.values["ended"], reply.finished) == (2, 1, False)
    assert reply.values["after"] > 5
