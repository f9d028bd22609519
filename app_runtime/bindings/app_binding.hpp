#pragma once

#include <pybind11/pybind11.h>

namespace sim2vr::bindings {

/// Adds the class App to the module.
void bindApp(pybind11::module_& module);

}  // namespace sim2vr::bindings
