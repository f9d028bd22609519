// The sky dome: directions with colours computed on the CPU (sky.cpp), at the far plane.
layout(location = 0) in vec3 a_direction;
layout(location = 1) in vec3 a_color;

out vec3 v_color;

void main() {
  vec3 eye = vec3(dot(u_eye_from_world[0].xyz, a_direction),
                  dot(u_eye_from_world[1].xyz, a_direction),
                  dot(u_eye_from_world[2].xyz, a_direction));
  gl_Position = project(eye);
  gl_Position.z = gl_Position.w;
  v_color = a_color;
}
