#include "nacre/pages.hpp"

#include <cstdint>
#include <cstring>
#include <fstream>
#include <stdexcept>

#if defined(__linux__)
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#endif

namespace nacre {

#if defined(__linux__)

namespace {

[[noreturn]] void fail(std::size_t bytes, const std::string& folder, int error) {
    throw std::runtime_error("scratch: cannot put " + std::to_string(bytes / 1000000 + 1) +
                             " MB in " + folder + ": " + std::strerror(error));
}

std::size_t page_size() { return static_cast<std::size_t>(sysconf(_SC_PAGESIZE)); }

}  // namespace

void* map_scratch_file(std::size_t bytes, const std::string& folder) {
    std::string name = folder + "/nacre-XXXXXX";
    const int file = mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) fail(bytes, folder, errno);
    unlink(name.c_str());
    int error = posix_fallocate(file, 0, static_cast<off_t>(bytes));
    void* first = MAP_FAILED;
    if (error == 0) {
        first = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        if (first == MAP_FAILED) error = errno;
    }
    close(file);  // the mapping keeps it
    if (error != 0) fail(bytes, folder, error);
    return first;
}

void unmap(void* first, std::size_t bytes) { munmap(first, bytes); }

void drop_pages(const void* first, std::size_t bytes) {
    const std::uintptr_t page = page_size();
    const auto begin = (reinterpret_cast<std::uintptr_t>(first) + page - 1) / page * page;
    const auto end = (reinterpret_cast<std::uintptr_t>(first) + bytes) / page * page;
    if (begin < end) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_DONTNEED);
}

void prefer_huge_pages(void* first, std::size_t bytes) { madvise(first, bytes, MADV_HUGEPAGE); }

std::size_t anonymous_memory() {
    // Pages: the whole, resident, resident and shared with files.
    std::ifstream statm("/proc/self/statm");
    std::size_t whole = 0, resident = 0, shared = 0;
    if (!(statm >> whole >> resident >> shared)) return 0;
    return (resident - shared) * page_size();
}

#else

void* map_scratch_file(std::size_t, const std::string&) {
    throw std::runtime_error("memory: a bound is not supported on this system");
}

void unmap(void*, std::size_t) {}
void drop_pages(const void*, std::size_t) {}
void prefer_huge_pages(void*, std::size_t) {}
std::size_t anonymous_memory() { return 0; }

#endif

}  // namespace nacre
