// Meshes and billboards. Variants: SHADING_UNLIT, SHADING_DIFFUSE, SHADING_SPECULAR.
layout(location = 0) in vec3 a_position;
layout(location = 1) in vec3 a_normal;
// Per instance (InstanceData in app_runtime/render/frame.hpp).
layout(location = 2) in vec4 a_eye_from_mesh_0;
layout(location = 3) in vec4 a_eye_from_mesh_1;
layout(location = 4) in vec4 a_eye_from_mesh_2;
layout(location = 5) in vec4 a_normal_scale;  // 1 / scale^2; w: strength of sky reflections
layout(location = 6) in vec4 a_diffuse;       // a: opacity, or -1 for opaque items
layout(location = 7) in vec4 a_specular;      // a: perceptual roughness

out float v_depth;
flat out vec4 v_diffuse;
#ifndef SHADING_UNLIT
out vec3 v_normal;
out vec3 v_added;  // light that is interpolated: side lights and mirrored sky
#endif
#ifdef SHADING_SPECULAR
out vec3 v_position;
flat out vec4 v_specular;
#endif

vec3 turn(vec3 v) {
  return vec3(dot(a_eye_from_mesh_0.xyz, v), dot(a_eye_from_mesh_1.xyz, v),
              dot(a_eye_from_mesh_2.xyz, v));
}

#ifndef SHADING_UNLIT
vec3 sideLight(vec3 normal) {
  vec3 light = vec3(0.0);
  for (int i = 0; i < 3; ++i) {
    light += max(dot(normal, u_side_direction[i].xyz), 0.0) * u_side_color[i].rgb;
  }
  return light;
}

// Unity's indirect specular term, with the sky reduced to three colours.
vec3 mirroredSky(vec3 normal, vec3 view) {
  float roughness = a_specular.a;
  float facing = clamp(abs(dot(normal, view)), 0.0, 1.0);
  float height = dot(reflect(-view, normal), u_up.xyz);
  float blur = 0.1 + 0.9 * roughness;
  vec3 sky = mix(u_sky_horizon.rgb, height > 0.0 ? u_sky_high.rgb : u_sky_ground.rgb,
                 smoothstep(0.0, blur, abs(height)));
  float grazing = clamp(1.0 - roughness + max(a_specular.r, 0.04), 0.0, 1.0);
  vec3 fresnel = mix(a_specular.rgb, vec3(grazing), pow(1.0 - facing, 5.0));
  float alpha = roughness * roughness;
  return sky * fresnel / (alpha * alpha + 1.0);
}
#endif

void main() {
  vec3 eye = turn(a_position) +
             vec3(a_eye_from_mesh_0.w, a_eye_from_mesh_1.w, a_eye_from_mesh_2.w);
  gl_Position = project(eye);
  v_depth = eye.z * u_depth_scale.x;
  v_diffuse = a_diffuse;
#ifndef SHADING_UNLIT
  vec3 normal = normalize(turn(a_normal * a_normal_scale.xyz));
  v_normal = normal;
  v_added = sideLight(normal) * a_diffuse.rgb;
  if (a_normal_scale.w > 0.0) {
    v_added += a_normal_scale.w * mirroredSky(normal, normalize(-eye));
  }
#endif
#ifdef SHADING_SPECULAR
  v_position = eye;
  v_specular = a_specular;
#endif
}
