window.beside = true; // an address that begins with a slash
