// Errors that leave the library. Wrong arguments and data throw std::invalid_argument with one
// line that names the argument and what was expected; a stop asked for by the progress callback
// throws Cancelled.
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace nacre {

class Cancelled : public std::runtime_error {
  public:
    Cancelled() : std::runtime_error("cancelled") {}
};

// require(rank <= size, "ranks: expected at most ", size, ", got ", rank)
template <class... Parts>
void require(bool condition, const Parts&... message) {
    if (condition) return;
    std::ostringstream text;
    (text << ... << message);
    throw std::invalid_argument(text.str());
}

}  // namespace nacre
