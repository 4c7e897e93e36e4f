#pragma once

#include <string_view>

namespace handhold {

/// Writes one line to stderr. Safe from many threads; a line is never torn.
/// error: a job or an item ends. warning: a person should look. info: one line per object or set.
void logError(std::string_view text);
void logWarning(std::string_view text);
void logInfo(std::string_view text);

/// While a progress line stands on the terminal, log lines first erase it. The empty string ends it.
void setProgressLine(std::string_view text);

}  // namespace handhold
