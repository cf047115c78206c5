// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/page_asset.h"

// The assembler includes the file, which costs the compiler nothing.
asm(R"(
  .pushsection .rodata
  .global mgsfm_page_asset_begin
  .global mgsfm_page_asset_end
mgsfm_page_asset_begin:
  .incbin ")" MGSFM_PAGE_ASSET_PATH R"("
mgsfm_page_asset_end:
  .byte 0
  .popsection
)");

extern "C" {
extern const char mgsfm_page_asset_begin[];
extern const char mgsfm_page_asset_end[];
}

namespace mgsfm {

std::string_view PageAsset() {
  return {mgsfm_page_asset_begin,
          static_cast<size_t>(mgsfm_page_asset_end - mgsfm_page_asset_begin)};
}

}  // namespace mgsfm
