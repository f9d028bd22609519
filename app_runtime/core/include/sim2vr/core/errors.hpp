// SPDX-License-Identifier: Apache-2.0
// Typed errors. Library code throws these and never exits; the bindings translate them in one place
// (InvalidArgument -> ValueError, the EngineError family -> RuntimeError).
#pragma once

#include <initializer_list>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace sim2vr {

/// A value that a caller passed cannot be used. Names the field, what was got and what was
/// expected.
class InvalidArgument : public std::invalid_argument {
 public:
  InvalidArgument(std::string_view field, std::string_view got, std::string_view expected);
  const std::string& field() const { return field_; }
  const std::string& got() const { return got_; }
  const std::string& expected() const { return expected_; }

 private:
  std::string field_, got_, expected_;
};

/// Something failed inside the runtime although the input was fine.
class EngineError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A call that the object's state does not allow (step before reset, use after close).
class StateError : public EngineError {
 public:
  using EngineError::EngineError;
};

/// No GL context could be made, a shader failed to compile, a framebuffer is incomplete.
class RenderError : public EngineError {
 public:
  using EngineError::EngineError;
};

/// "; did you mean 'medium'?" for the candidate nearest to `got`, or "" when none is near.
std::string didYouMean(std::string_view got, std::span<const std::string> candidates);

/// "'a', 'b' or 'c'".
std::string listChoices(std::span<const std::string> choices);

/// "one of 'a', 'b' or 'c'", with the one that `got` is near to. Of more than twelve choices only
/// the near one is named, where there is one.
std::string oneOf(std::span<const std::string> choices, std::string_view got);

}  // namespace sim2vr
