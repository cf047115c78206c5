# CTest runs this with cmake -P; CMakeLists.txt defines the variables.
set(prefix ${WORK_DIR}/prefix)
set(examples ${WORK_DIR}/examples)
set(data ${WORK_DIR}/data)
file(REMOVE_RECURSE ${prefix} ${examples} ${data})

function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ERROR_IS_FATAL ANY)
endfunction()

run(${CMAKE_COMMAND} --install ${MGSFM_BUILD_DIR} --prefix ${prefix})
run(${CMAKE_COMMAND} -S ${MGSFM_SOURCE_DIR}/examples -B ${examples} -G Ninja
  -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH=${prefix})
run(${CMAKE_COMMAND} --build ${examples})

foreach(file man/man1/mgsfm.1 man/man1/mgsfm-mapper.1
    bash-completion/completions/mgsfm zsh/site-functions/_mgsfm
    fish/vendor_completions.d/mgsfm.fish)
  if(NOT EXISTS ${prefix}/share/${file})
    message(FATAL_ERROR "share/${file} was not installed")
  endif()
endforeach()

set(mgsfm ${prefix}/bin/mgsfm)
run(${mgsfm} --version)
run(${mgsfm} simulate --output_path ${data} --preset standard --num_frames 12)
# Images are decoded.
string(REPEAT "0 255 " 2048 pixels)
file(WRITE ${data}/images/a.pgm "P2 64 64 255\n${pixels}\n")
run(${mgsfm} feature_extractor --image_path ${data}/images
  --database_path ${data}/images.db)
run(${examples}/average_rotations ${data}/database.db)
run(${examples}/map_database ${data}/database.db ${data}/sparse)
run(${examples}/adjust_model ${data}/sparse/0 ${data}/adjusted)
# The program reads what the examples wrote, and finds the same poses.
run(${mgsfm} model_evaluator --input_path ${data}/adjusted
  --gt_path ${data}/truth)
