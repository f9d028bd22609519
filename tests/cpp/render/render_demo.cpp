// SPDX-License-Identifier: Apache-2.0
// Developers' tool, not a test: writes pictures of the demo scene and measures the CPU time of one.
// Usage: render_demo <folder> [automatic|egl|osmesa]
#include <time.h>

#include <cstdio>
#include <string>
#include <vector>

#include "demo_scene.hpp"
#include "sim2vr/render/image_io.hpp"
#include "sim2vr/render/renderer.hpp"

namespace {

using namespace sim2vr::render;

/// CPU time of this thread, so that other programs do not count.
double cpuMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

double millisecondsPerFrame(Renderer& renderer, const sim2vr::scene::Scene& scene,
                            const Camera& camera, ImageSize size, int frames) {
  std::vector<std::uint8_t> rgba(4 * size.pixels());
  for (int i = 0; i < 5; ++i) renderer.render(scene, camera, size, rgba);
  const double start = cpuMilliseconds();
  for (int i = 0; i < frames; ++i) renderer.render(scene, camera, size, rgba);
  return (cpuMilliseconds() - start) / frames;
}

void write(Renderer& renderer, const sim2vr::scene::Scene& scene, const Camera& camera,
           ImageSize size, const std::string& path) {
  std::vector<std::uint8_t> rgba(4 * size.pixels());
  renderer.render(scene, camera, size, rgba);
  std::vector<std::uint8_t> rgb, depth;
  for (std::size_t i = 0; i < size.pixels(); ++i) {
    rgb.insert(rgb.end(), {rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]});
    depth.push_back(rgba[4 * i + 3]);
  }
  writePng(path + ".png", size, rgb, 3);
  writePng(path + "_depth.png", size, depth, 1);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string folder = argc > 1 ? argv[1] : ".";
  const auto renderer = Renderer::create(rendererKindFromName(argc > 2 ? argv[2] : "automatic"));
  std::printf("%s\n", renderer->description().c_str());
  sim2vr::scene::Scene empty, sky, full;
  demo::addSurroundings(sky);
  demo::addSurroundings(full);
  demo::addObjects(full);
  Camera& head = demo::addHeadCamera(full);
  Camera& figure = demo::addFigureCamera(full);
  write(*renderer, full, head, {120, 80}, folder + "/head_120x80");
  write(*renderer, full, head, {1280, 960}, folder + "/head_1280x960");
  write(*renderer, full, figure, {456, 257}, folder + "/figure_456x257");
  const auto report = [&](const char* name, const sim2vr::scene::Scene& scene, const Camera& camera,
                          ImageSize size, int frames) {
    std::printf("%-8s %4d x %-4d %8.3f ms\n", name, size.width, size.height,
                millisecondsPerFrame(*renderer, scene, camera, size, frames));
  };
  report("empty", empty, demo::addHeadCamera(empty), {120, 80}, 1000);
  report("sky", sky, demo::addHeadCamera(sky), {120, 80}, 1000);
  report("full", full, head, {120, 80}, 1000);
  report("full", full, figure, {456, 257}, 100);
  report("full", full, head, {1280, 960}, 20);
}
