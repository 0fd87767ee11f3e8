# Bundles the page's script: fetches the pinned libraries once, then one file from all of them.
# cmake -DNPM=... -DSOURCE=... -DWORK=... -DOUT=... -P bundle.cmake
file(SHA256 ${SOURCE}/package-lock.json lock)
set(stamp ${WORK}/installed)
set(installed "")
if(EXISTS ${stamp})
  file(READ ${stamp} installed)
endif()
if(NOT installed STREQUAL lock)
  file(REMOVE ${stamp})
  file(COPY ${SOURCE}/package.json ${SOURCE}/package-lock.json DESTINATION ${WORK})
  execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund --prefer-offline --loglevel=error
                  WORKING_DIRECTORY ${WORK} RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "npm could not fetch the report's chart and 3D libraries (see above). Without network, build "
                        "everything but servocal-report: cmake --preset ... -DSERVOCAL_REPORT_PAGE=OFF")
  endif()
  file(WRITE ${stamp} ${lock})
endif()
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env NODE_PATH=${WORK}/node_modules ${WORK}/node_modules/.bin/esbuild main.js --bundle
          --minify --format=iife --target=es2020 --legal-comments=eof --log-level=warning
          --outfile=${OUT}
  WORKING_DIRECTORY ${SOURCE} RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "esbuild could not bundle the report's script")
endif()
