// SPDX-License-Identifier: Apache-2.0
// write_sample_ply DEGREE FILE: a random model for checks with other programs' readers.
#include <cstdlib>
#include <iostream>

#include "lib/model/ply.h"
#include "tests/model/model_helpers.h"

int main(int argc, char** argv) {
    if (argc != 3) {
        std::cerr << "usage: write_sample_ply DEGREE FILE\n";
        return 2;
    }
    const gs::AppearanceSpec appearance{"sh", std::atoi(argv[1]), gs::ColorActivation::kRelu};
    gs::write_ply(argv[2], gs::test::random_gaussians(1000, appearance), {.iteration = 1});
}
