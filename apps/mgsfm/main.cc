// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm_commit.h"
#include "program.h"

int main(int argc, char** argv) {
  return mgsfm::RunProgram({argv + 1, argv + argc}, MGSFM_COMMIT);
}
