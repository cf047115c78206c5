# MGSFM_SANITIZE, e.g. "address,undefined", applies to all targets.
if(MGSFM_SANITIZE)
  add_compile_options(-fsanitize=${MGSFM_SANITIZE} -fno-omit-frame-pointer
    -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${MGSFM_SANITIZE})
endif()
