// Shared by the writers of files: the contents, and a stream that reports a full disk.
#pragma once

#include "impl.h"

#include <unistd.h>

#include <cerrno>
#include <ostream>
#include <streambuf>
#include <vector>

namespace druse {

struct FileOut::Impl {
  std::vector<std::unique_ptr<Grid>> grids;
  openvdb::MetaMap metadata;
};

// A seekable stream onto a file descriptor. It keeps the first error number, and rejects bytes after cancellation.
class DescriptorBuffer final : public std::streambuf {
 public:
  DescriptorBuffer(int descriptor, Interrupter& interrupter) : descriptor_(descriptor), interrupter_(interrupter) {
    buffer_.resize(1 << 20);  // a call of the system for each mebibyte
    setp(buffer_.data(), buffer_.data() + buffer_.size());
  }

  int error() const { return error_; }

 protected:
  int_type overflow(int_type c) override {
    if (!flush()) return traits_type::eof();
    if (!traits_type::eq_int_type(c, traits_type::eof())) {
      *pptr() = traits_type::to_char_type(c);
      pbump(1);
    }
    return traits_type::not_eof(c);
  }

  int sync() override { return flush() ? 0 : -1; }

  pos_type seekoff(off_type offset, std::ios_base::seekdir whence, std::ios_base::openmode) override {
    // A query of the position must not flush: OpenVDB makes one for every node.
    if (whence == std::ios_base::cur && offset == 0) return pos_type(position_ + (pptr() - pbase()));
    if (!flush()) return pos_type(off_type(-1));
    const int origin = whence == std::ios_base::beg ? SEEK_SET : whence == std::ios_base::cur ? SEEK_CUR : SEEK_END;
    const off_t at = ::lseek(descriptor_, offset, origin);
    if (at < 0) {
      fail(errno);
      return pos_type(off_type(-1));
    }
    position_ = at;
    return pos_type(at);
  }

  pos_type seekpos(pos_type position, std::ios_base::openmode mode) override {
    return seekoff(off_type(position), std::ios_base::beg, mode);
  }

 private:
  bool flush() {
    const char* from = pbase();
    while (from < pptr()) {
      if (interrupter_.wasInterrupted()) return fail(ECANCELED);
      const ssize_t n = ::write(descriptor_, from, static_cast<std::size_t>(pptr() - from));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return fail(errno);
      if (n == 0) return fail(ENOSPC);
      from += n;
      position_ += n;
    }
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return error_ == 0;
  }

  bool fail(int number) {
    if (error_ == 0) error_ = number;
    return false;
  }

  int descriptor_;
  Interrupter& interrupter_;
  std::vector<char> buffer_;
  off_t position_ = 0;
  int error_ = 0;
};

// Runs `work` on a stream to a descriptor; returns 0, or the error number of the first write that failed.
template <typename Work>
std::int32_t write_through(std::int32_t descriptor, const Host& host, Work&& work) {
  Interrupter interrupter(host);
  DescriptorBuffer buffer(descriptor, interrupter);
  try {
    std::ostream os(&buffer);
    os.exceptions(std::ios::badbit | std::ios::failbit);
    work(os);
    os.flush();
  } catch (...) {
    if (buffer.error() != 0) return buffer.error();
    throw;
  }
  return buffer.error();
}

}  // namespace druse
