// SPDX-License-Identifier: Apache-2.0
#include "shaders.hpp"

#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::render {
namespace {

constexpr std::size_t kLogSize = 4096;

GLuint compile(const gl::Functions& gl, GLenum stage, const std::string& file,
               const std::string& variant) {
  const std::string define = variant.empty() ? "" : fmt::format("#define {} 1\n", variant);
  const std::string text =
      "#version 420 core\n" + define + shaderText("frame.glsl") + "#line 1\n" + shaderText(file);
  const GLuint shader = gl.CreateShader(stage);
  const char* source = text.c_str();
  gl.ShaderSource(shader, 1, &source, nullptr);
  gl.CompileShader(shader);
  GLint ok = 0;
  gl.GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
  if (ok == GL_TRUE) return shader;
  std::array<char, kLogSize> log{};
  gl.GetShaderInfoLog(shader, static_cast<GLsizei>(log.size()), nullptr, log.data());
  gl.DeleteShader(shader);
  throw RenderError(fmt::format("shader {} {} does not compile: {}", file, variant, log.data()));
}

}  // namespace

std::string shaderText(std::string_view file_name) {
  if (const char* folder = std::getenv("SIM2VR_SHADER_DIR")) {
    std::ifstream file(std::filesystem::path(folder) / file_name);
    if (file) return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  const auto found = embeddedShaders().find(std::string(file_name));
  if (found == embeddedShaders().end()) {
    throw RenderError(fmt::format("there is no shader file '{}'", file_name));
  }
  return found->second;
}

GLuint buildProgram(const gl::Functions& gl, const std::string& name, const std::string& variant) {
  const GLuint vertex = compile(gl, GL_VERTEX_SHADER, name + ".vert", variant);
  const GLuint fragment = compile(gl, GL_FRAGMENT_SHADER, name + ".frag", variant);
  const GLuint program = gl.CreateProgram();
  gl.AttachShader(program, vertex);
  gl.AttachShader(program, fragment);
  gl.LinkProgram(program);
  gl.DeleteShader(vertex);
  gl.DeleteShader(fragment);
  GLint ok = 0;
  gl.GetProgramiv(program, GL_LINK_STATUS, &ok);
  if (ok != GL_TRUE) {
    std::array<char, kLogSize> log{};
    gl.GetProgramInfoLog(program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    gl.DeleteProgram(program);
    throw RenderError(fmt::format("shader {} {} does not link: {}", name, variant, log.data()));
  }
  const GLuint block = gl.GetUniformBlockIndex(program, "Frame");
  if (block != GL_INVALID_INDEX) gl.UniformBlockBinding(program, block, 0);
  return program;
}

}  // namespace sim2vr::render
