// What is known of the games without playing them.
#pragma once

#include <pybind11/pybind11.h>

namespace sim2vr::bindings {

void bindGames(pybind11::module_& module);

}  // namespace sim2vr::bindings
