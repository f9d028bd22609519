// Values of one picture, shared by all programs. Layout: FrameUniforms in app_runtime/render/frame.hpp.
// Eye space keeps the app's handedness: x right, y up, z forward, metres. Colours are linear light.
layout(std140) uniform Frame {
  vec4 u_projection;         // x scale, y scale, z scale, z offset
  vec4 u_depth_scale;        // x: 1 / far; y, z: the frustum's middle over its half width, height
  vec4 u_eye_from_world[3];  // rows of the rotation
  vec4 u_main_direction;     // towards the brightest light, eye space
  vec4 u_main_color;
  vec4 u_side_direction[3];  // the other lights
  vec4 u_side_color[3];
  vec4 u_up;                 // world up in eye space
  vec4 u_sky_high;           // the sky as mirrored by surfaces
  vec4 u_sky_horizon;
  vec4 u_sky_ground;
};

// The picture is drawn upside down, so that the first row read back is the top one.
vec4 project(vec3 eye) {
  return vec4(eye.x * u_projection.x - eye.z * u_depth_scale.y,
              eye.z * u_depth_scale.z - eye.y * u_projection.y,
              eye.z * u_projection.z + u_projection.w, eye.z);
}
