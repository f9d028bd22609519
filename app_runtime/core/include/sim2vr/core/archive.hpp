// SPDX-License-Identifier: Apache-2.0
// One field list per type drives save, load and state hash: a type writes
//   void fields(Archive& a) { a.field("score", score_); a.field("rng", rng_); }
// and the archive either appends the values to a byte string or reads them back. Field names are
// part of the bytes, so that a state of another layout is refused instead of misread.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "sim2vr/core/math.hpp"

namespace sim2vr {

/// The values that a saved number may have, ends included; NaN is in no range.
struct Range {
  double low;
  double high;
};
/// Of what is counted: far above any round's, and far enough from the largest int to go on.
inline constexpr Range kCounts{0.0, 1e9};
/// Of quantities: times, lengths, speeds and sums of them.
inline constexpr Range kQuantities{-1e12, 1e12};

class Archive {
 public:
  /// An archive that appends to an empty byte string.
  static Archive saver() { return Archive(); }
  /// An archive that reads `bytes` from the start.
  static Archive loader(std::string bytes);

  bool loading() const { return loading_; }
  const std::string& bytes() const { return bytes_; }
  /// 64-bit FNV-1a hash of the saved bytes.
  std::uint64_t hash() const;
  /// Throws EngineError when a loader has bytes left over.
  void expectEnd() const;
  /// Saves how this machine orders the bytes of a number; a loader throws EngineError for bytes of
  /// another order.
  void byteOrder();

  /// Saves or loads one value under `name`. Types: arithmetic, enum, std::string, Eigen vectors and
  /// quaternions, Pose, std::array/vector/optional/map/pair of these, and anything with
  /// fields(Archive&).
  template <class T>
  void field(std::string_view name, T& value) {
    static_assert(!std::is_enum_v<T>, "say which enumerator is the last: field(name, value, last)");
    tag(name);
    transfer(value);
  }

  /// The same for an enumeration whose enumerators run from 0 to `last`. A loader throws
  /// EngineError naming the field for a value that is none of them.
  template <class E>
    requires std::is_enum_v<E>
  void field(std::string_view name, E& value, E last) {
    tag(name);
    transfer(value);
    if (loading_) expectIn({0.0, static_cast<double>(last)}, name, static_cast<double>(value));
  }

  /// The same for a number, or an array of numbers, that arithmetic follows. A loader throws
  /// EngineError naming the field for a value outside the range.
  template <class T>
  void field(std::string_view name, T& value, Range range) {
    field(name, value);
    if (!loading_) return;
    if constexpr (std::is_arithmetic_v<T>) {
      expectIn(range, name, static_cast<double>(value));
    } else {
      for (const auto& number : value) expectIn(range, name, static_cast<double>(number));
    }
  }

 private:
  Archive() = default;

  static void expectIn(Range range, std::string_view name, double value);

  void tag(std::string_view name);
  void raw(void* data, std::size_t size);
  std::uint64_t count(std::size_t size);

  template <class T>
    requires(std::is_arithmetic_v<T> || std::is_enum_v<T>)
  void transfer(T& value) {
    raw(&value, sizeof(value));
  }
  void transfer(bool& value);
  void transfer(std::string& value) {
    value.resize(count(value.size()));
    raw(value.data(), value.size());
  }
  void transfer(Quat& value) { raw(value.coeffs().data(), 4 * sizeof(double)); }
  void transfer(Pose& value) {
    transfer(value.position);
    transfer(value.rotation);
  }
  template <class S, int R, int C>
  void transfer(Eigen::Matrix<S, R, C>& value) {
    static_assert(R > 0 && C > 0, "fixed-size matrices only");
    raw(value.data(), sizeof(S) * R * C);
  }
  template <class T, std::size_t N>
  void transfer(std::array<T, N>& values) {
    for (T& value : values) transfer(value);
  }
  template <class T>
  void transfer(std::vector<T>& values) {
    const std::uint64_t size = count(values.size());
    if (size < values.size()) values.resize(size);
    // Grown while its elements are read: an element is larger in memory than in the bytes, so that
    // a damaged count must meet the end of the bytes first.
    for (std::size_t i = 0; i < size; ++i) {
      if (i == values.size()) values.emplace_back();
      if constexpr (std::is_same_v<T, bool>) {
        bool value = values[i];
        transfer(value);
        values[i] = value;
      } else {
        transfer(values[i]);
      }
    }
  }
  template <class T>
  void transfer(std::optional<T>& value) {
    bool present = value.has_value();
    transfer(present);
    if (!present) {
      value.reset();
      return;
    }
    // Not emplace(): clang takes a class nested in an unfinished one for not constructible there.
    if (!value) value = T{};
    transfer(*value);
  }
  template <class A, class B>
  void transfer(std::pair<A, B>& value) {
    transfer(value.first);
    transfer(value.second);
  }
  template <class K, class V>
  void transfer(std::map<K, V>& values) {
    std::vector<std::pair<K, V>> items(values.begin(), values.end());
    transfer(items);
    if (loading_) values = std::map<K, V>(items.begin(), items.end());
  }
  template <class T>
    requires requires(T& t, Archive& a) { t.fields(a); }
  void transfer(T& value) {
    value.fields(*this);
  }

  bool loading_ = false;
  std::string bytes_;
  std::size_t offset_ = 0;
};

}  // namespace sim2vr
