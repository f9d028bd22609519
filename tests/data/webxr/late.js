window.lateScript();
