// SPDX-License-Identifier: Apache-2.0
// sim2vr-app: a VR game of the runtime as a program of its own.
#include "sim2vr/program/program.hpp"

int main(int argc, char** argv) { return sim2vr::program::run(argc, argv); }
