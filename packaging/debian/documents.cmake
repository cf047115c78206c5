# CPack runs this script before it builds packages: adds copyright and changelogs
# to each, and compresses man pages.
set(packages program=mgsfm dev=libmgsfm-dev python=python3-mgsfm)
set(source ${CPACK_MGSFM_SOURCE_DIR})

# The time of the commit, so that packages of one commit are equal.
execute_process(COMMAND git -C ${source} log -1 --format=%cD
  OUTPUT_VARIABLE date OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(NOT date)
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
endif()
file(READ ${source}/LICENSE license)
string(REGEX REPLACE "\n\n" "\n.\n" license "${license}")
string(REGEX REPLACE "\n" "\n " license "${license}")
string(STRIP "${license}" license)

foreach(item IN LISTS packages)
  string(REPLACE "=" ";" item ${item})
  list(GET item 0 component)
  list(GET item 1 package)
  set(root ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/${component}/usr/share)
  if(NOT EXISTS ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/${component})
    continue()
  endif()
  set(doc ${root}/doc/${package})
  file(WRITE ${doc}/copyright
"Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: mgsfm

Files: *
Copyright: 2025, the mgsfm authors
License: BSD-3-clause
 ${license}
")
  file(WRITE ${doc}/changelog.Debian
"mgsfm (${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}) unstable; urgency=medium

  * Packages by CPack; see the changelog of the program.

 -- ${CPACK_PACKAGE_CONTACT}  ${date}
")
  configure_file(${source}/CHANGELOG.md ${doc}/changelog COPYONLY)
  file(GLOB pages ${root}/man/man1/*.1)
  execute_process(
    COMMAND gzip -9nf ${doc}/changelog ${doc}/changelog.Debian ${pages}
    COMMAND_ERROR_IS_FATAL ANY)
  execute_process(COMMAND chmod -R u=rwX,go=rX
    ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/${component}
    COMMAND_ERROR_IS_FATAL ANY)
endforeach()
