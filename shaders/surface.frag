// Lambert light, and for SHADING_SPECULAR the highlight of Unity's Standard shader (GGX).
in float v_depth;
flat in vec4 v_diffuse;
#ifndef SHADING_UNLIT
in vec3 v_normal;
in vec3 v_added;
#endif
#ifdef SHADING_SPECULAR
in vec3 v_position;
flat in vec4 v_specular;
#endif

layout(location = 0) out vec4 o_color;

#ifdef SHADING_SPECULAR
vec3 highlight(vec3 normal, vec3 light, float n_l) {
  vec3 view = normalize(-v_position);
  vec3 middle = normalize(light + view);
  float n_v = abs(dot(normal, view));
  float n_h = max(dot(normal, middle), 0.0);
  float l_h = max(dot(light, middle), 0.0);
  float alpha = max(v_specular.a * v_specular.a, 0.002);
  float visibility =
      0.5 / (n_l * (n_v * (1.0 - alpha) + alpha) + n_v * (n_l * (1.0 - alpha) + alpha) + 1e-5);
  float d = (n_h * alpha * alpha - n_h) * n_h + 1.0;
  float distribution = alpha * alpha / (d * d + 1e-7);
  float x = 1.0 - l_h;
  float x2 = x * x;
  vec3 fresnel = v_specular.rgb + (1.0 - v_specular.rgb) * (x2 * x2 * x);
  return visibility * distribution * n_l * fresnel;
}
#endif

void main() {
#ifdef SHADING_UNLIT
  vec3 color = v_diffuse.rgb;
#else
  vec3 normal = normalize(v_normal);
  if (!gl_FrontFacing) normal = -normal;
  float n_l = max(dot(normal, u_main_direction.xyz), 0.0);
  vec3 reflected = v_diffuse.rgb * n_l;
#ifdef SHADING_SPECULAR
  reflected += highlight(normal, u_main_direction.xyz, n_l);
#endif
  vec3 color = reflected * u_main_color.rgb + v_added;
#endif
  // Rounded here, so that every driver stores the nearest of the 255 steps.
  float depth = floor(v_depth * 255.0 + 0.5) * (1.0 / 255.0);
  o_color = vec4(color, v_diffuse.a < 0.0 ? depth : v_diffuse.a);
}
