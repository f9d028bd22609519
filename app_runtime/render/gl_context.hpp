// SPDX-License-Identifier: Apache-2.0
// An OpenGL context without a window, and the scope in which it is current on a thread.
#pragma once

#include <memory>
#include <string>

namespace sim2vr::render {

class GlContext {
 public:
  GlContext() = default;
  virtual ~GlContext() = default;
  GlContext(const GlContext&) = delete;
  GlContext& operator=(const GlContext&) = delete;

  /// What made it: "EGL surfaceless", "EGL device 0", "OSMesa".
  virtual const std::string& platform() const = 0;
  /// Address of a GL function, or nullptr.
  virtual void* lookup(const char* name) const = 0;

  /// While it lives the context is current on this thread; then the one before is current again.
  class ScopedCurrent {
   public:
    ScopedCurrent() = default;
    virtual ~ScopedCurrent() = default;
    ScopedCurrent(const ScopedCurrent&) = delete;
    ScopedCurrent& operator=(const ScopedCurrent&) = delete;
  };
  virtual std::unique_ptr<ScopedCurrent> makeCurrent() = 0;
};

/// Throw RenderError that says what was tried and which package mends it.
std::unique_ptr<GlContext> createEglContext();
std::unique_ptr<GlContext> createOsMesaContext();

/// Remembers the thread's current EGL context, if any, and makes it current again when it goes.
/// Does nothing in a process without EGL.
class EglCurrentKeeper {
 public:
  EglCurrentKeeper();
  ~EglCurrentKeeper();
  EglCurrentKeeper(const EglCurrentKeeper&) = delete;
  EglCurrentKeeper& operator=(const EglCurrentKeeper&) = delete;

  bool found() const { return context_ != nullptr; }
  /// Takes the context off the thread now.
  void release() const;

 private:
  unsigned api_ = 0;
  void* display_ = nullptr;
  void* context_ = nullptr;
  void* draw_ = nullptr;
  void* read_ = nullptr;
};

/// The same for OSMesa, in a process that has loaded it. Mesa's drivers share one dispatch table
/// per thread, so that each of the two kinds of context takes the thread from the other; and OSMesa
/// takes the other's context for its own, so that it may only be asked when EGL has none (`ask`).
class OsMesaCurrentKeeper {
 public:
  explicit OsMesaCurrentKeeper(bool ask);
  ~OsMesaCurrentKeeper();
  OsMesaCurrentKeeper(const OsMesaCurrentKeeper&) = delete;
  OsMesaCurrentKeeper& operator=(const OsMesaCurrentKeeper&) = delete;

 private:
  void* context_ = nullptr;
  void* buffer_ = nullptr;
  int width_ = 0;
  int height_ = 0;
};

}  // namespace sim2vr::render
