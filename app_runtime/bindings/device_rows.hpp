// Poses and inputs as they come from numpy: a row for every app, or for every frame of every app.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/numpy.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/xr/pose_row.hpp"

namespace sim2vr::bindings {

template <class T>
using Array = pybind11::array_t<T, pybind11::array::c_style | pybind11::array::forcecast>;
using Rows = Array<double>;
using OptionalRows = std::optional<Rows>;
using Shape = std::vector<pybind11::ssize_t>;

template <class T>
void checkShape(const char* name, const Array<T>& array, const Shape& shape) {
  const Shape got(array.shape(), array.shape() + array.ndim());
  if (got == shape) return;
  throw InvalidArgument(name, fmt::format("shape ({})", fmt::join(got, ", ")),
                        fmt::format("shape ({})", fmt::join(shape, ", ")));
}

/// Arrays of one shape with a row's numbers behind it; a device that is not tracked and inputs at
/// rest are missing. They must outlive this object.
class DeviceRows {
 public:
  struct Arrays {
    const Rows& head;
    const OptionalRows& left;
    const OptionalRows& right;
    const OptionalRows& left_inputs;
    const OptionalRows& right_inputs;
  };

  DeviceRows(const Arrays& arrays, const Shape& shape)
      : head_(checked("head", arrays.head, shape, xr::kPoseRowNumbers)),
        left_(checked("left_controller", arrays.left, shape, xr::kPoseRowNumbers)),
        right_(checked("right_controller", arrays.right, shape, xr::kPoseRowNumbers)),
        left_inputs_(checked("left_inputs", arrays.left_inputs, shape, xr::kInputRowNumbers)),
        right_inputs_(checked("right_inputs", arrays.right_inputs, shape, xr::kInputRowNumbers)) {}

  /// Row i, whatever the shape in front. Throws as xr::inputsFromRow.
  xr::DeviceState operator[](pybind11::ssize_t i) const {
    const auto row = [i](const double* rows, int numbers) {
      return rows == nullptr ? nullptr : rows + i * numbers;
    };
    std::array<xr::ControllerState, 2> inputs;
    if (left_ != nullptr) {
      inputs[0] = xr::inputsFromRow(xr::Hand::left, row(left_inputs_, xr::kInputRowNumbers));
    }
    if (right_ != nullptr) {
      inputs[1] = xr::inputsFromRow(xr::Hand::right, row(right_inputs_, xr::kInputRowNumbers));
    }
    return xr::devicesFromRows(row(head_, xr::kPoseRowNumbers), row(left_, xr::kPoseRowNumbers),
                               row(right_, xr::kPoseRowNumbers), inputs);
  }

 private:
  static const double* checked(const char* name, const Rows& rows, Shape shape, int numbers) {
    shape.push_back(numbers);
    checkShape(name, rows, shape);
    return rows.data();
  }
  static const double* checked(const char* name, const OptionalRows& rows, const Shape& shape,
                               int numbers) {
    return rows ? checked(name, *rows, shape, numbers) : nullptr;
  }

  const double* head_;
  const double* left_;
  const double* right_;
  const double* left_inputs_;
  const double* right_inputs_;
};

}  // namespace sim2vr::bindings
