# MGSFM_SANITIZE, e.g. "address,undefined", applies to all targets.
if(MGSFM_SANITIZE)
  add_compile_options(-fsanitize=${MGSFM_SANITIZE} -fno-omit-frame-pointer
    -fno-sanitize-recover=all
    # Checks of every pointer that is followed. What they would find, the address
    # sanitizer or the processor reports when it happens; they make compiling
    # three times as long.
    -fno-sanitize=null,alignment,object-size,vptr)
  add_link_options(-fsanitize=${MGSFM_SANITIZE})
endif()
