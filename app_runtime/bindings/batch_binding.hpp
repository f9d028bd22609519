// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace sim2vr::bindings {

/// Adds the class AppBatch to the module.
void bindAppBatch(pybind11::module_& module);

}  // namespace sim2vr::bindings
