# SPDX-License-Identifier: Apache-2.0
# Writes the short hash of the checked-out commit as a C string, with "-dirty" where files differ from it.
# Without git or outside a repository the string is empty.
execute_process(COMMAND git -C ${SOURCE_DIR} describe --always --dirty --exclude=*
  OUTPUT_VARIABLE hash OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed)
  set(hash "")
endif()
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "\"${hash}\"\n")
