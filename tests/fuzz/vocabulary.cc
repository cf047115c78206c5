// SPDX-License-Identifier: BSD-3-Clause
#include "matching/vocabulary.h"

#include "fuzz/fuzz_target.h"

namespace mgsfm {

// A vocabulary tree, which assigns a word to every descriptor.
void FuzzVocabulary(const std::string& input) {
  const std::string path = (FuzzFolder() / "tree.bin").string();
  const std::string again = (FuzzFolder() / "again.bin").string();
  WriteTextFile(path, input);
  Accepts([&] {
    const Vocabulary tree = Vocabulary::Read(path);
    for (const uint8_t value : {0, 100, 255}) {
      const std::vector<uint8_t> descriptor(128, value);
      const int word = tree.FindWord(descriptor.data());
      FUZZ_CHECK(word >= 0 && word < tree.num_words());
    }
    tree.Write(again);
    FUZZ_CHECK(Vocabulary::Read(again).num_words() == tree.num_words());
  });
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(vocabulary, mgsfm::FuzzVocabulary)
