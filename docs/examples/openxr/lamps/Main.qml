import QtQuick
import QtQuick3D
import QtQuick3D.Xr

XrView {
    id: view

    property int seed: 1
    property int score: 0
    property int misses: 0

    depthSubmissionEnabled: true  // users see how far things are
    referenceSpace: XrView.ReferenceSpace.ReferenceSpaceStage

    environment: SceneEnvironment {
        clearColor: "#303840"
        backgroundMode: SceneEnvironment.Color
    }

    // The same numbers on every machine.
    function random() {
        seed = (seed * 48271) % 2147483647
        return seed / 2147483647
    }

    function nextLamp() {
        lamp.centre = Qt.vector3d(-15 + 45 * random(), 90 + 35 * random(), -38 - 10 * random())
        lamp.phase = 2 * Math.PI * random()
        lamp.place()
        const metres = lamp.centre.times(0.01)
        console.log("lamp: " + metres.x + " " + metres.y + " " + metres.z)
    }

    function pull() {
        const gap = hand.scenePosition.minus(lamp.scenePosition).length()
        if (gap > 13) {
            misses += 1
            console.log("misses: " + misses)
            return
        }
        score += 1
        console.log("score: " + score)
        buzz.trigger = true
        buzz.trigger = false
        nextLamp()
    }

    Component.onCompleted: {
        for (let k = 0; k < 3; ++k)
            random()
        nextLamp()
    }

    // Time counts from the first frame: until then it is the machine's.
    property real begin: -1
    onFrameReady: {
        if (begin < 0)
            begin = Date.now()
    }

    FrameAnimation {
        running: true
        onTriggered: lamp.place()
    }

    xrOrigin: origin

    DirectionalLight {
        eulerRotation: Qt.vector3d(-40, -20, 0)
        ambientColor: "#606060"
    }

    XrOrigin {
        id: origin

        XrController {
            id: hand
            controller: XrController.ControllerRight
            poseSpace: XrController.GripPose

            Model {
                source: "#Cube"
                scale: Qt.vector3d(0.03, 0.03, 0.12)
                materials: PrincipledMaterial { baseColor: "#4080ff" }
            }
        }
    }

    XrInputAction {
        id: trigger
        hand: XrInputAction.RightHand
        actionId: [XrInputAction.TriggerValue]
        onPressedChanged: if (pressed) view.pull()
    }

    XrHapticFeedback {
        id: buzz
        controller: XrHapticFeedback.ControllerRight
        condition: XrHapticFeedback.RisingEdge
        hapticEffect: XrSimpleHapticEffect { amplitude: 0.7; duration: 60; frequency: 200 }
    }

    Model {
        id: lamp

        property vector3d centre
        property real phase: 0

        function place() {
            const seconds = view.begin < 0 ? 0 : (Date.now() - view.begin) / 1000
            const angle = phase + 1.5 * seconds
            position = Qt.vector3d(centre.x + 6 * Math.cos(angle), centre.y, centre.z)
        }

        source: "#Sphere"
        scale: Qt.vector3d(0.14, 0.14, 0.14)
        materials: PrincipledMaterial { baseColor: "#ff9010"; emissiveFactor: Qt.vector3d(0.5, 0.25, 0) }
    }

    // A room: a floor and a wall behind the lamps.
    Model {
        source: "#Rectangle"
        position: Qt.vector3d(0, 0, 0)
        eulerRotation: Qt.vector3d(-90, 0, 0)
        scale: Qt.vector3d(6, 6, 1)
        materials: PrincipledMaterial { baseColor: "#505a50" }
    }
    Model {
        source: "#Rectangle"
        position: Qt.vector3d(0, 150, -300)
        scale: Qt.vector3d(8, 4, 1)
        materials: PrincipledMaterial { baseColor: "#606878" }
    }
}
